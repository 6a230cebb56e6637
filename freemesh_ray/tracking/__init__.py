"""MLflow tracking that training never waits for and never fails by; the one package that imports MLflow.

What a run records is first appended, as JSON lines, to a journal in the run's folder; a thread of its own uploads the
journal to the store in batches:

    metrics(...) --> <run folder>/tracking/<id>.jsonl --> thread: log_batch --> MLflow store
                     <run folder>/tracking/<id>.json  (how far, which MLflow run)

So the queue between training and the store is a file: it takes no memory, it outlives a killed process, and what an
absent store did not get is delivered by the run's resumption or by `sync`. Delivery can be repeated: an entry keeps its
time stamp, and MLflow stores equal entries once. The journal is locked while its run lives; the kernel frees the lock
of a killed process, which is how a later start tells a killed run (and marks it FAILED) from one still at work.

What is delivered, to where and from which folder is told by who calls, and never by a journal or a store: see `journal`
(files of this user's below a folder), `uploader` (runs of this user's in the store), `store` (one address) and
`killed_runs` (what a start does for those before it).

A study is one run with a child for each trial. A child names its parent by the parent's `MLflowRun.id`, which is known
before any store was reached; its journal waits until the parent is in the store. A policy is registered the same way.
What came of all trials is told by `summary`: the study's description and figures, and a run for each variant.
"""

from freemesh_ray.tracking.journal import page
from freemesh_ray.tracking.late_delivery import sync
from freemesh_ray.tracking.mlflow_run import MLflowRun, Status
from freemesh_ray.tracking.mlflow_store import TrackingError, absolute, browsing
from freemesh_ray.tracking.model_registry import register
from freemesh_ray.tracking.past_study import summarise
from freemesh_ray.tracking.sharing import share
from freemesh_ray.tracking.study_run import Summary, VariantSummary

__all__ = [
    "MLflowRun", "Status", "Summary", "TrackingError", "VariantSummary", "absolute", "browsing", "page", "register",
    "share", "summarise", "sync",
]  # fmt: skip
