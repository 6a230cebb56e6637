"""Records of a study: one Parquet file with all that its report needs, without run folders, policies or training.

schema (what the columns are) -> measured, study_records (what is recorded) -> table (rows) -> parquet_file
"""
