"""Touch soft bodies: haptic rendering of contact with nonlinear deformable bodies.

A `Body` is what is touched: it is opened from a file, or made of samples or a spec. A `Contact` is one tool on it: `step` takes where
the tool is and gives the force, `rollout` does that along a `Path`, and `rollout_many` along thousands, on all cores. A `Session` runs a
device on a body, with its limits and watchdogs. All is in SI units, in the body's frame; what fails raises a child of `Error`.
"""

from ._palpate import (
    FLAGS,
    RECORD_DTYPE,
    TRACE_DTYPE,
    VERSION,
    ArgumentError,
    Body,
    BusyError,
    CancelledError,
    Contact,
    Error,
    InputError,
    Outcome,
    Output,
    Path,
    Progress,
    Session,
    SessionError,
    Snapshot,
    __version__,
    flag_names,
    read_mesh,
    rollout_many,
)

__all__ = [
    "FLAGS",
    "RECORD_DTYPE",
    "TRACE_DTYPE",
    "VERSION",
    "ArgumentError",
    "Body",
    "BusyError",
    "CancelledError",
    "Contact",
    "Error",
    "InputError",
    "Outcome",
    "Output",
    "Path",
    "Progress",
    "Session",
    "SessionError",
    "Snapshot",
    "__version__",
    "flag_names",
    "read_mesh",
    "rollout_many",
]
