"""Pictures of controllers: what they show is what the traces hold; saved and loaded; pages that hold them."""

import io
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine
from pipeline.errors import InputError
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import WorkspaceSpecification
from pipeline.reaching.metrics import load_traces, path_lengths
from pipeline.reporting import pictures
from pipeline.reporting.chapters.controllers import FOLD_ABOVE, controller_section, film_section
from pipeline.reporting.figures.episode_chart import EpisodeChart, EpisodeCourse
from pipeline.reporting.figures.film import Film, film_bytes, outcome, shown_ticks
from pipeline.reporting.figures.paths import path_figure, paths_of
from pipeline.reporting.page import PNG, SVG, WEBP, Figure, Points, Section, render_page
from pipeline.reporting.pictures import Pictures, learning_curves, load_pictures, save_pictures, success_rates
from pipeline.reporting.results.controllers import by_controller, read_controllers
from pipeline.reporting.results.paper import SIMULATED
from pipeline.reporting.tables.evaluation import differences
from tests.reporting.made_up import N_EPISODES, N_TICKS, random_traces, write_controller

WORKSPACE = WorkspaceSpecification(0.9, 2.6, 0.85, 0.155, 2.5, 0.155)
WIDTH, HEIGHT = 320, 240


@pytest.fixture(scope="module")
def controllers(tmp_path_factory):
    artifacts = tmp_path_factory.mktemp("artifacts")
    for seed in (0, 1):
        write_controller(artifacts, "ppo_mlp_dqdot", seed, random_traces(seed), {"steps": 2000})
    return read_controllers(artifacts, {"ppo_mlp_dqdot": [0, 1]})


def test_drawn_paths_are_as_long_as_the_metric_says():
    traces = random_traces(3)
    ways = paths_of(traces, np.zeros((N_EPISODES, 3)))
    lengths = [np.linalg.norm(np.diff(way.astype(float), axis=0), axis=1).sum() for way in ways.positions]
    np.testing.assert_allclose(lengths, path_lengths(traces), rtol=1e-5)
    assert ways.reached.any() and not ways.reached.all()


def test_path_figure_takes_more_controllers_than_fit_side_by_side():
    ways = paths_of(random_traces(3), np.full((2, 3), 1.2))
    one, five = (
        Image.open(io.BytesIO(path_figure({f"controller {i}": ways for i in range(n)}, WORKSPACE))).size
        for n in (1, 5)
    )
    assert five[0] > one[0] and five[1] > 1.8 * one[1]


def test_a_film_ends_two_seconds_after_the_target_or_after_ten():
    reached = np.zeros(500, bool)
    assert shown_ticks(reached, 20.0) == 200
    reached[59:] = True
    assert shown_ticks(reached, 20.0) == 60 + 40
    assert shown_ticks(reached[:70], 20.0) == 70


def test_outcome_names_the_moment_or_the_nearest():
    traces = random_traces(3)
    for episode in range(N_EPISODES):
        said = outcome(traces, episode, 0.05)
        ticks = [
            t
            for t in range(N_TICKS)
            if traces.position_error[episode, t] < 0.02 and abs(traces.pitch_error[episode, t]) < 0.02
        ]
        if ticks:
            assert said == f"reached within 0.02 m and 0.02 rad after {0.05 * (ticks[0] + 1):.1f} s"
        else:
            assert f"nearest were {traces.position_error[episode].min():.3f} m" in said


def test_the_chart_veils_what_is_to_come_and_nothing_before():
    t_s = 0.05 * np.arange(1, 101)
    course = EpisodeCourse(t_s, 1.0 / t_s, np.sin(t_s), np.sign(np.sin(3 * t_s))[:, None] * np.ones(2))
    chart = EpisodeChart(course, ["lift", "tilt"], WIDTH, HEIGHT)
    early, half, end = (chart.at(t).astype(int) for t in (0.05, 2.5, 5.0))
    assert early.shape == (HEIGHT, WIDTH, 3)
    changed = np.flatnonzero((half != end).any(axis=(0, 2)))
    middle = (
        changed[0] + changed[-1]
    ) / 2  # half of the time is half of the axis: the changed half starts there
    begin = np.flatnonzero((early != end).any(axis=(0, 2)))[0]
    assert changed[0] - begin == pytest.approx(changed[-1] - changed[0], abs=4) and middle > begin
    assert (half[:, changed[0] + 2 :] >= end[:, changed[0] + 2 :]).mean() > 0.99  # lighter


def test_film_has_its_frames():
    pictures = [np.full((24, 32, 3), shade, np.uint8) for shade in (0, 120, 240)]
    film = Image.open(io.BytesIO(film_bytes(Film(pictures, "reached"), 10)))
    assert (film.format, film.n_frames, film.size) == ("WEBP", 3, (32, 24))


def test_traces_survive_the_disk_and_damage_is_named(controllers, tmp_path):
    loaded, original = load_traces(controllers[1].evaluation / "traces.npz"), random_traces(1)
    for name in original._fields:
        np.testing.assert_array_equal(getattr(loaded, name), getattr(original, name))
    (tmp_path / "traces.npz").write_bytes(b"damaged")
    with pytest.raises(InputError, match="write it anew"):
        load_traces(tmp_path / "traces.npz")
    with pytest.raises(InputError, match="no such file"):
        load_traces(tmp_path / "none.npz")


def test_matrices_show_the_mean_over_seeds(controllers):
    figure = success_rates(by_controller(controllers))
    assert "PPO MLP Δq̇: 2 seeds, 12 episodes each" in figure.caption
    assert figure.media_type == SVG and figure.content.startswith(b"<?xml")


def test_learning_curves_take_the_steps_that_all_seeds_share(controllers):
    short = [*controllers]
    short[1] = type(short[1])(**{**vars(short[1]), "curve": short[1].curve[:2]})
    assert (
        learning_curves(by_controller(short)).content != learning_curves(by_controller(controllers)).content
    )


def test_sampled_poses_are_those_of_the_evaluation(controllers, monkeypatch):
    drawn = {}
    monkeypatch.setattr(pictures, "cloud_figure", lambda clouds, workspace: drawn.update(clouds) or b"png")
    arm = load_arm(load_machine("bobcat_e10"), MACHINE_DIRECTORY)
    figure = pictures.sampled_poses(load_machine("bobcat_e10"), arm, controllers)
    starts, targets = drawn.values()
    assert starts.position.shape == (N_EPISODES, 3) and f"The {N_EPISODES} starts" in figure.caption
    np.testing.assert_allclose(targets.pitch, 0.5 - 1.5 - 0.5 + np.pi / 2, atol=1e-6)  # as made up


def test_pictures_survive_the_disk(tmp_path):
    figures = {"paths": Figure("Paths", "of α", b"png", PNG), "rates": Figure("Rates", "%", b"<svg/>", SVG)}
    pictures = Pictures({"ppo_mlp_dq": Figure("PPO", "seed 0", b"webp", WEBP)}, None, figures)
    save_pictures(tmp_path / "pictures", pictures)
    assert load_pictures(tmp_path / "pictures") == pictures
    (tmp_path / "pictures/film_ppo_mlp_dq.webp").unlink()
    with pytest.raises(InputError, match=r"film_ppo_mlp_dq\.webp"):
        load_pictures(tmp_path / "pictures")


class Sources(HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources, self.folded = [], 0

    def handle_starttag(self, tag, attributes):
        self.sources += [value for name, value in attributes if name == "src"]
        self.folded += tag == "details"


def test_the_page_needs_no_other_file_and_folds_what_is_to_be_folded(controllers):
    film = Figure("PPO", "seed 0", b"webp", WEBP)
    sections = [
        film_section({"ppo_mlp_dqdot": film}, None),
        controller_section(controllers, {"rates": success_rates(by_controller(controllers))}, SIMULATED),
        Section("Lists", "Two.", points=[Points("Folded", ["one"], folded=True), Points("Open", ["two"])]),
    ]
    page = render_page("Title", "Verdict", [], sections, [])
    parser = Sources()
    parser.feed(page)
    assert len(parser.sources) == 2 and all(source.startswith("data:") for source in parser.sources)
    n_differences = len(differences(controllers, SIMULATED))
    assert parser.folded == 1 + (n_differences > FOLD_ABOVE)
    assert re.search(r'class="gallery"', page)


def test_without_opengl_the_page_says_so():
    section = film_section({}, "rendering needs OpenGL")
    assert section.answer == "No picture: rendering needs OpenGL" and not section.figures
