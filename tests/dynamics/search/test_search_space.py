"""The search spaces are the paper's, and proposals stay within them and reach all of them."""

import random
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.search_space import SearchSpace, propose
from pipeline.errors import InputError
from pipeline.study.configuration import SearchConfig

ROOT = Path(__file__).parents[3]

# Table "Search spaces for the dynamic models hyperparameters"; the learning rates without its misprint.
COMMON = {
    "lags": set(range(18, 26)),
    "learning_rate": {1e-3, 1e-4, 1e-5},
    "batch_size": {256, 512, 1024, 2048},
}
PAPER = {
    "mlp": COMMON | {"horizon": {4, 8, 16, 32}, "layers": {2, 3, 4, 5}, "units": {64, 128, 256, 512}},
    "kan": COMMON | {"horizon": {8, 16, 32}, "layers": {3, 4, 5}, "units": {4, 8, 16, 32}},
}
EPOCHS = {"mlp": 1000, "kan": 1200}


def profile_spaces(profile: str) -> dict[Parameterization, SearchSpace]:
    content = OmegaConf.load(ROOT / "conf/profile/paper.yaml").search
    if profile != "paper":
        content = OmegaConf.merge(content, OmegaConf.load(ROOT / f"conf/profile/{profile}.yaml").search)
    return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(SearchConfig), content)).spaces


@pytest.mark.parametrize("kind", ["mlp", "kan"])
def test_the_paper_profiles_space_is_the_papers(kind):
    space = profile_spaces("paper")[Parameterization(kind)]
    for name, options in PAPER[kind].items():
        assert set(getattr(space, name)) == options
    assert space.maximum_epochs == EPOCHS[kind]


@pytest.mark.parametrize("kind", ["mlp", "kan"])
def test_proposals_cover_the_papers_space_and_nothing_else(kind):
    space, chooser = profile_spaces("paper")[Parameterization(kind)], random.Random(0)
    drawn = [propose(space, lambda name, options: chooser.choice(options)) for _ in range(2000)]
    for name in ("lags", "learning_rate", "batch_size", "horizon"):
        assert {getattr(training, name) for training in drawn} == PAPER[kind][name]
    assert {len(training.hidden) for training in drawn} == PAPER[kind]["layers"]
    for layer in range(max(PAPER[kind]["layers"])):
        units = {training.hidden[layer] for training in drawn if len(training.hidden) > layer}
        assert units == PAPER[kind]["units"]
    assert any(len(set(training.hidden)) > 1 for training in drawn)  # drawn for each layer


def test_each_layer_has_a_name_and_absent_layers_none():
    asked = []

    def choose(name, options):
        asked.append(name)
        return options[-1] if name == "layers" else options[0]

    training = propose(SearchSpace([3], [0.1], [8], [4], [1, 3], [5, 7], 9), choose)
    assert training.hidden == [5, 5, 5]
    assert sorted(asked) == sorted(
        ["layers", "units_1", "units_2", "units_3", "lags", "horizon", "learning_rate", "batch_size"]
    )


@pytest.mark.parametrize("profile", ["default", "smoke"])
def test_the_other_profiles_have_spaces_for_both_kinds(profile):
    assert set(profile_spaces(profile)) == set(Parameterization)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"units": []}, "units is empty"),
        ({"lags": [18, 18]}, "list each option once"),
        ({"lags": [-1]}, "lags is"),
        ({"learning_rate": [0.0]}, "learning_rate is"),
        ({"horizon": [0]}, "horizon is"),
        ({"maximum_epochs": 0}, "maximum_epochs is 0"),
    ],
)
def test_an_impossible_space_is_refused(change, said):
    options = {
        "lags": [0],
        "learning_rate": [0.1],
        "batch_size": [8],
        "horizon": [4],
        "layers": [1],
        "units": [5],
        "maximum_epochs": 1,
    }
    SearchSpace(**options)
    with pytest.raises(InputError, match=said):
        SearchSpace(**(options | change))
