"""iCEM in plain NumPy loops, written from Algorithm 1 of Pinneri et al. (2021), one episode at a time."""

import numpy as np
from scipy.stats import norm


class LoopPlanner:
    """Is given the noise that the planner under test draws; all else is its own."""

    def __init__(self, config, shift, shape):
        self.c, self.shift = config, shift
        self.mean, self.std = np.zeros(shape), np.full(shape, config.initial_std)
        self.elites = []  # (return, sequence), best first

    def sample(self, noise):
        if self.c.bounds == "clip":
            return [np.clip(self.mean + self.std * z, -1, 1) for z in noise]
        low, high = norm.cdf((-1 - self.mean) / self.std), norm.cdf((1 - self.mean) / self.std)
        return [self.mean + self.std * norm.ppf(low + norm.cdf(z) * (high - low)) for z in noise]

    def decide(self, value, noises, shift_noise):
        c = self.c
        n = float(c.samples)
        for i in range(c.iterations):
            count = c.samples if i == 0 else min(c.samples, max(2 * c.elites, int(n)))
            n /= c.sample_decay
            samples = self.sample(noises[i][:count])
            if c.mean_in_last_iteration and i == c.iterations - 1:
                samples[0] = self.mean.copy()
            pool = [(value(s), s) for s in samples]
            n_reused = int(c.elite_fraction * c.elites)
            if i == 0 and c.shift_elites:
                last = self.sample(shift_noise)
                for (_, elite), fresh in zip(self.elites[:n_reused], last[: len(self.elites)], strict=False):
                    moved = np.concatenate([elite[self.shift :], fresh[-self.shift :]])
                    pool.append((value(moved), moved))
            if i > 0 and c.keep_elites:
                pool += self.elites[:n_reused]
            pool.sort(key=lambda pair: -pair[0])
            self.elites = pool[: c.elites]
            stacked = np.array([sequence for _, sequence in self.elites])
            self.mean = c.momentum * self.mean + (1 - c.momentum) * stacked.mean(axis=0)
            self.std = c.momentum * self.std + (1 - c.momentum) * stacked.std(axis=0)
        first = self.elites[0][1][0] if c.execute_best else self.mean[0]
        if c.shift_mean:
            self.mean = np.concatenate(
                [self.mean[self.shift :], np.repeat(self.mean[-1:], self.shift, axis=0)]
            )
        else:
            self.mean = np.zeros_like(self.mean)
        initial = np.full_like(self.std, c.initial_std)
        if c.reset_std:
            self.std = initial
        else:
            self.std = np.concatenate([self.std[self.shift :], initial[: self.shift]])
        return first
