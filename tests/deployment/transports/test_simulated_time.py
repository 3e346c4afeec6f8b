"""Simulated time: delays as measured, order of links, determinism."""

import json

import numpy as np
import pytest

from pipeline.deployment.component import Component, Publication, nanoseconds
from pipeline.deployment.messages import MachineCommand, Topic
from pipeline.deployment.transports.simulated_time.delays import (
    LINKS,
    DelaySampler,
    Distribution,
    lengthened,
    load_delays,
    no_delays,
    save_delays,
)
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.errors import InputError


class Talker(Component):
    name = "talker"
    period_ns = nanoseconds(0.01)

    def __init__(self) -> None:
        self.n = 0

    def on_timer(self, now_ns):
        self.n += 1
        return (Publication(Topic.joint_commands, MachineCommand(now_ns, np.array([self.n]))),)


class Listener(Component):
    name = "listener"
    subscriptions = (Topic.joint_commands,)

    def __init__(self) -> None:
        self.heard: list[tuple[int, int, int]] = []

    def on_message(self, topic, message, now_ns):
        self.heard.append((now_ns, message.stamp_ns, int(message.values[0])))
        return ()


def talk(delay: Distribution, seed: int = 0, seconds: float = 5.0) -> np.ndarray:
    listener = Listener()
    delays = {**no_delays(), "command": delay}
    graph = SimulatedGraph([Talker(), listener], delays, np.random.SeedSequence(seed))
    graph.run(nanoseconds(seconds))
    return np.array(listener.heard)


def test_a_link_keeps_its_order_even_where_delays_exceed_the_period() -> None:
    heard = talk(Distribution(np.array([0.0, 0.1]), 0.0))
    assert (np.diff(heard[:, 2]) == 1).all() and (np.diff(heard[:, 0]) >= 0).all()


def test_delays_follow_the_distribution() -> None:
    """Shorter than the period, so that no message waits for another: uniform in 1 to 5 ms."""
    heard = talk(Distribution(np.array([0.001, 0.005]), 0.0), seconds=60.0)
    delays_s = (heard[:, 0] - heard[:, 1]) * 1e-9
    np.testing.assert_allclose(np.quantile(delays_s, [0.1, 0.5, 0.9]), [0.0014, 0.003, 0.0046], atol=1e-4)
    assert delays_s.min() >= 0.001 and delays_s.max() <= 0.005


def test_the_share_that_is_lost_is_lost() -> None:
    heard = talk(Distribution(np.zeros(2), 0.2), seconds=60.0)
    assert len(heard) / 6000 == pytest.approx(0.8, abs=4 * np.sqrt(0.16 / 6000))


def test_the_seed_decides_everything() -> None:
    delay = Distribution(np.array([0.0, 0.02]), 0.1)
    np.testing.assert_array_equal(talk(delay), talk(delay))
    assert not np.array_equal(talk(delay)[:20], talk(delay, seed=1)[:20])


def test_quantiles_come_back_from_their_samples_and_from_the_file(tmp_path) -> None:
    delays_s = np.random.default_rng(0).gamma(2.0, 1e-3, 4000)
    measured = Distribution.of(delays_s, n_lost=1000)
    assert measured.loss_probability == 0.2
    drawn = DelaySampler(Distribution.of(delays_s), np.random.SeedSequence(0))
    again = np.array([drawn.draw_ns() for _ in range(20000)]) * 1e-9
    probabilities = [0.05, 0.5, 0.95, 0.99]
    np.testing.assert_allclose(
        np.quantile(again, probabilities), np.quantile(delays_s, probabilities), rtol=0.05
    )
    path = tmp_path / "delays.json"
    save_delays(path, dict.fromkeys(LINKS, measured), {"command": "test"})
    loaded = load_delays(path).links["inference"]
    np.testing.assert_allclose(loaded.quantiles_s, measured.quantiles_s, atol=1e-7)
    assert loaded.loss_probability == measured.loss_probability


def test_files_that_are_none_are_named(tmp_path) -> None:
    with pytest.raises(InputError, match="no such file; measure it"):
        load_delays(tmp_path / "delays.json")
    (tmp_path / "delays.json").write_text("{}")
    with pytest.raises(InputError, match="not a file of delays"):
        load_delays(tmp_path / "delays.json")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda content: content.pop("measured"), "not a file of delays .*measured"),
        (lambda content: content.update(measured=[]), "not a file of delays"),
        (lambda content: content["measured"].update(planner=5984), "not a file of delays"),
        (lambda content: content["measured"].update(planner={"model_steps": 5984}), "model_parameters"),
        (
            lambda content: content["measured"].update(planner={"model_steps": "a", "model_parameters": 9}),
            "whole positive",
        ),
        (lambda content: content["links"].pop("timer"), "not a file of delays .*timer"),
        (lambda content: content["links"]["timer"].update(quantiles_s=[0.2, 0.1]), "timer are not ascending"),
        (
            lambda content: content["links"]["timer"].update(quantiles_s=[0.0, np.inf]),
            "timer are not ascending",
        ),
        (lambda content: content["links"]["timer"].update(quantiles_s=0.1), "timer are not ascending"),
        (lambda content: content.update(schema_version=2), "schema_version 2"),
    ],
)
def test_what_is_damaged_in_a_file_is_said_in_one_line(tmp_path, change, said: str) -> None:
    path = tmp_path / "delays.json"
    effort = {"planner": {"model_steps": 5984, "model_parameters": 14468}}
    save_delays(path, no_delays(), effort)
    assert load_delays(path).planner is not None
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=said) as caught:
        load_delays(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_lengthened_loop_takes_so_much_longer_on_its_way_round():
    """Joint state to the server, command to the interface, command to the driver; decisions and ticks as measured."""
    measured = {name: Distribution.of(np.linspace(0.0, 0.01, 50), n_lost=1) for name in LINKS}
    longer = lengthened(measured, 0.2)
    added = {name: longer[name].quantiles_s - measured[name].quantiles_s for name in LINKS}
    np.testing.assert_allclose(added["observation"] + 2.0 * added["command"], 0.2)
    assert not added["inference"].any() and not added["timer"].any()
    assert all(longer[name].loss_probability == measured[name].loss_probability for name in LINKS)
