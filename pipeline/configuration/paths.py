"""Types of a stage's keys that are paths: what is only read, what is written, and the check of all of them."""

from typing import Annotated, Any, get_args, get_type_hints

from pipeline.errors import InputError
from pipeline.files.path_checks import Input, Output, refuse_overlap, refuse_unusable

InputPath = Annotated[str, Input()]
InputLogs = Annotated[str, Input(is_of_logs=True)]  # a folder that is searched for logs
InputLogFolders = Annotated[Any, Input(is_of_logs=True)]  # one such folder, or a list of them
InputModel = Annotated[str, Input(is_whole=True)]  # a folder that holds one thing: a model, a policy
OutputFolder = Annotated[str, Output()]
OutputFile = Annotated[str, Output(is_file=True)]
CheckpointFolder = Annotated[str, Output(replaced=(".",))]  # deleted once the run is finished


def check_paths(configuration: Any) -> None:
    """Check that nothing that is only read would be changed, and that what is to be written can be.

    Args:
        configuration: A dataclass with keys of the types above.

    Raises:
        InputError: A path is for both, or cannot be written to; a list of inputs is empty.
    """
    reads: dict[str, tuple[list[str], Input]] = {}
    writes: dict[str, tuple[str, Output]] = {}
    for key, kind in get_type_hints(type(configuration), include_extras=True).items():
        given, mark = getattr(configuration, key), _mark(kind)
        if isinstance(mark, Output) and given is not None and "://" not in given:  # a database is not a path
            refuse_unusable(key, given, mark.is_file)
            writes[key] = given, mark
        elif isinstance(mark, Input) and given == []:
            raise InputError(f"{key} is empty; name at least one folder to read")
        elif isinstance(mark, Input) and given:
            reads[key] = [given] if isinstance(given, str) else given, mark
    refuse_overlap(writes, reads)


def _mark(kind: Any) -> Input | Output | None:
    """What a type says of a path, wherever in it: `InputModel`, `list[InputModel]`, `InputModel | None`."""
    if isinstance(kind, Input | Output):
        return kind
    of_annotated = (*get_args(kind), *getattr(kind, "__metadata__", ()))
    return next((mark for part in of_annotated if (mark := _mark(part)) is not None), None)
