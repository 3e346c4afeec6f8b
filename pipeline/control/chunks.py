"""Evaluation in chunks of episodes: finished chunks are stored, so that a killed evaluation resumes."""

import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

from pipeline.control.evaluate import EvaluatedEpisodes
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import Traces
from pipeline.reaching.reward import RewardTerms


def episode_keys(seed: int, n: int) -> jax.Array:
    """A key per episode, (n,): an episode's randomness depends on the seed and its number alone."""
    return jax.vmap(jax.random.fold_in, in_axes=(None, 0))(jax.random.key(seed), np.arange(n))


def evaluate_in_chunks(
    evaluate: Callable[[Episodes, jax.Array], EvaluatedEpisodes],
    episodes: Episodes,
    seed: int,
    chunk: int,
    directory: Path | None,
    evaluation: str,
    progress: Callable[[int], None],
) -> EvaluatedEpisodes:
    """Evaluate all episodes; the result does not depend on the chunks, up to rounding.

    Args:
        evaluate: function of episodes and their keys.
        episodes: N episodes.
        seed: seed of the controller's random numbers.
        chunk: episodes at once; the last chunk is padded with repeated ones, so that one compilation suffices.
        directory: folder of finished chunks, or None.
        evaluation: `checkpoint.identity` of the evaluation; chunks of other evaluations are ignored.
        progress: called with the number of episodes of each chunk.

    Raises:
        InputError: a stored chunk is damaged.
    """
    keys = episode_keys(seed, len(episodes.starts))
    parts = []
    for begin in range(0, len(episodes.starts), chunk):
        index = np.arange(begin, min(begin + chunk, len(episodes.starts)))
        path = None if directory is None else Path(directory) / f"episodes_{begin:06d}_{len(index)}.npz"
        part = None if path is None else _load(path, evaluation)
        if part is None:
            filled = np.resize(index, chunk)
            part = evaluate(Episodes(episodes.starts[filled], episodes.targets[filled]), keys[filled])
            part = _first(part, len(index))
            if path is not None:
                _save(path, evaluation, part)
        parts.append(part)
        progress(len(index))
    return jax.tree.map(lambda *values: np.concatenate(values), *parts)


def is_chunk(path: Path) -> bool:
    """Whether the name is that of a chunk of `evaluate_in_chunks`."""
    return re.fullmatch(r"episodes_\d{6,}_\d+\.npz", path.name) is not None


def _first(part: EvaluatedEpisodes, n: int) -> EvaluatedEpisodes:
    return jax.tree.map(lambda value: value[:n], part)


def _save(path: Path, evaluation: str, part: EvaluatedEpisodes) -> None:
    content = io.BytesIO()
    np.savez(content, evaluation=evaluation, **dict(_named(part)))
    write_whole(path, content.getvalue())


def _load(path: Path, evaluation: str) -> EvaluatedEpisodes | None:
    """The chunk; None if it is missing or belongs to another evaluation."""
    try:
        with np.load(path) as content:
            if str(content["evaluation"]) != evaluation:
                return None
            traces = Traces(*(content[f"traces_{name}"] for name in Traces._fields))
            terms = RewardTerms(*(content[f"terms_{name}"] for name in RewardTerms._fields))
            return EvaluatedEpisodes(traces, terms)
    except FileNotFoundError:
        return None
    except (KeyError, ValueError, EOFError, OSError) as error:
        raise InputError(f"{path}: not readable as a chunk of episodes ({error}); delete it") from None


def _named(part: EvaluatedEpisodes) -> Iterator[tuple[str, Any]]:
    for name, values in part._asdict().items():
        for field, value in values._asdict().items():
            yield f"{name}_{field}", np.asarray(value)
