"""What docs/controllers.md says of the settings that are left to Brax, against the installed Brax."""

import ast
import functools
import inspect
import re
from pathlib import Path

import brax.training
import pytest
from brax.training import distribution
from brax.training.agents.ppo import networks
from brax.training.agents.ppo import train as brax_ppo

from pipeline.configuration.load import load_section
from pipeline.control import ppo
from pipeline.control.ppo import PPOConfig

PAGE = Path(__file__).parents[2] / "docs/controllers.md"
SOURCES = Path(brax.training.__file__).parent
ROW = re.compile(r"^\| [^|]+ \| `(\w+)` \| ([^|]+) \| (\S+\.py):(\d+) \|$", re.MULTILINE)
ROWS = {name: (value, SOURCES / file, int(line)) for name, value, file, line in ROW.findall(PAGE.read_text())}

# How a training is run and watched, which the policy does not depend on; the others act only beside what is off.
RUNNING = {"max_devices_per_host", "wrap_env", "use_pmap_on_reset", "progress_fn", "log_training_metrics"}
RUNNING |= {"training_metrics_steps", "eval_env", "deterministic_eval"}
RUNNING |= {"save_checkpoint_path", "restore_checkpoint_path", "restore_params", "restore_value_fn"}
OF_PIXELS_AND_PHYSICS = {"vision", "augment_pixels", "randomization_fn"}
OF_AN_ADAPTIVE_RATE = {"desired_kl", "learning_rate_schedule_min_lr", "learning_rate_schedule_max_lr"}


def written(value: object) -> str:
    """A default as the page writes it; of functions, the name."""
    return getattr(value, "__name__", str(value))


def left_to_brax() -> dict[str, object]:
    """Defaults of Brax's training that ours does not set."""
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(ppo))) if isinstance(node, ast.Call)]
    (call,) = [call for call in calls if ast.unparse(call.func) == "ppo.train"]
    passed = {keyword.arg for keyword in call.keywords}
    signature = inspect.signature(brax_ppo.train).parameters
    return {name: parameter.default for name, parameter in signature.items() if name not in passed}


def test_every_setting_that_is_left_to_brax_is_named() -> None:
    of_the_algorithm = set(left_to_brax()) - RUNNING - OF_PIXELS_AND_PHYSICS - OF_AN_ADAPTIVE_RATE
    assert of_the_algorithm == set(ROWS) & set(inspect.signature(brax_ppo.train).parameters)


@pytest.mark.parametrize("name", ROWS)
def test_its_value_and_its_line_are_brax_s(name: str) -> None:
    value, file, line = ROWS[name]
    text = file.read_text().splitlines()[line - 1]
    assert re.search(rf"\b{name}\b", text)
    defaults = left_to_brax() | {
        name: parameter.default
        for function in (networks.make_ppo_networks, distribution.NormalTanhDistribution.__init__)
        for name, parameter in inspect.signature(function).parameters.items()
    }
    # a row of the optimiser belongs to no argument; it is read off the line
    assert written(defaults[name]) == value if name in defaults else value in text


def test_networks_are_left_to_brax_but_for_their_hidden_layers() -> None:
    factory = ppo._network_factory(load_section("ppo", PPOConfig))
    assert isinstance(factory, functools.partial) and not factory.args
    assert set(factory.keywords) == {"policy_hidden_layer_sizes", "value_hidden_layer_sizes"}
