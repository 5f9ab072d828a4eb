"""What can go wrong, one class per cause that a user can act on."""


class AmbidError(Exception):
    """Base of every error that ambid raises on purpose."""


class InputError(AmbidError):
    """Something the user gave is wrong; the message names it, its value, and what is allowed."""


class RigError(InputError):
    """A rig file or rig object is wrong: names the key, the value found and what is allowed."""


class RecordError(InputError):
    """A record is wrong: names the file, the channel, the value found and what to do."""


class ModelError(InputError):
    """A request on a model is wrong: an unknown parameter, a start outside its bounds, a wrong shape."""


class OutputError(AmbidError):
    """A file could not be written: names it, the reason, such as a full disk, and what to do."""


class UnstableLoopError(AmbidError):
    """The simulated closed loop is unstable, so that it has no response to compare."""


class Stopped(KeyboardInterrupt):
    """Ctrl-C during a job that had something to show: passes on like any KeyboardInterrupt.

    Attributes
    ----------
    result : object
        What was done before, such as an `Estimate` or a `Diagnosis`, marked as stopped.
    """

    def __init__(self, result: object) -> None:
        super().__init__("stopped by Ctrl-C")
        self.result = result


class IdentificationError(AmbidError):
    """The data and the model were accepted, but the job could not be done."""
