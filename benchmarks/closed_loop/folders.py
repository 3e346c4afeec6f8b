"""Where the three programs keep what they hand on to each other, all below one root."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml
from omegaconf import OmegaConf

from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.machine.specification import CommandKind, JointKind, MachineSpecification

CLOSED, OPEN = 0o000, 0o700  # modes of the folder of seals
CONFIGURATION = "conf"  # of a case: `machine/<name>.yaml`, all that a solver may know besides the logs


@dataclass(frozen=True)
class Folders:
    """The folders below a root."""

    root: Path

    @property
    def cases(self) -> Path:
        """One folder per case: `nominal`, `measured` and `exam` bags, and the machine's description."""
        return self.root / "cases"

    @property
    def seals(self) -> Path:
        """One truth per case."""
        return self.root / "seals"

    @property
    def solutions(self) -> Path:
        """One folder per case: what `close_loop` wrote, its log, and what became of it."""
        return self.root / "solutions"

    def complete(self, name: str, machine: MachineSpecification) -> None:
        """Describe a case's machine, which makes the case complete."""
        joints = [
            {"name": of.name, "kind": str(JointKind(of.kind)), "lower": of.lower, "upper": of.upper}
            for of in machine.joints
        ]
        content = {
            "name": machine.name,
            "rate_hz": machine.rate_hz,
            "command_kind": str(CommandKind(machine.command_kind)),
            "joints": joints,
        }
        folder = self.cases / name / CONFIGURATION / "machine"
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / f"{machine.name}.yaml", yaml.safe_dump(content, sort_keys=False).encode())

    def is_complete(self, name: str) -> bool:
        """Whether a case was written whole."""
        return self._description(name) is not None

    def machine(self, name: str) -> MachineSpecification:
        """Of a complete case."""
        path = self._description(name)
        if path is None:
            raise InputError(
                f"{self.cases / name}: no machine is described; run benchmarks.closed_loop.generate"
            )
        content = OmegaConf.load(path)
        machine: MachineSpecification = OmegaConf.to_object(
            OmegaConf.merge(OmegaConf.structured(MachineSpecification), content)
        )
        return machine

    def complete_cases(self) -> list[str]:
        """Names of the cases that were written whole, in order."""
        if not self.cases.is_dir():
            return []
        return sorted(path.name for path in self.cases.glob("[!.]*") if self.is_complete(path.name))

    def _description(self, name: str) -> Path | None:
        return next((self.cases / name / CONFIGURATION / "machine").glob("*.yaml"), None)


@contextmanager
def sealed(seals: Path) -> Iterator[None]:
    """No one may enter the folder of seals meanwhile."""
    seals.chmod(CLOSED)
    try:
        yield
    finally:
        seals.chmod(OPEN)


def readable(folder: Path) -> bool:
    """Whether this process can look into a folder; tried, because the superuser's permissions tell nothing."""
    try:
        os.listdir(folder)
    except PermissionError:
        return False
    return True
