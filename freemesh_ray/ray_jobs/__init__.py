"""Jobs on a Ray cluster: the line that submits a training or a study, and the command that runs it."""
