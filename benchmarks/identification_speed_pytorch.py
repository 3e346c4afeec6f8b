"""The PyTorch side of identification_speed.py: same model, loss and optimiser, as one would write it.

Imports NumPy and PyTorch only, so that it runs in an environment of its own. Reads the data from a file, then
answers each line on standard input, a number of epochs, with one line of JSON.
"""

import json
import os
import sys
import time

import numpy as np
import torch


class OpenLoopLoss(torch.nn.Module):
    """H steps of a Δq̇ model from measured rows, and the mean squared error norm."""

    def __init__(self, case: dict, layers: list[tuple[np.ndarray, np.ndarray]]) -> None:
        super().__init__()
        modules: list[torch.nn.Module] = []
        for kernel, bias in layers:
            linear = torch.nn.Linear(*kernel.shape)
            with torch.no_grad():
                linear.weight.copy_(torch.from_numpy(kernel.T.copy()))
                linear.bias.copy_(torch.from_numpy(bias))
            modules += [linear, torch.nn.SiLU()]
        self.network = torch.nn.Sequential(*modules[:-1])
        self.lags, self.horizon, self.dt_s = case["lags"], case["horizon"], case["dt_s"]
        for name in ("lower", "upper", "velocity_limit", "residual_scale"):
            self.register_buffer(name, torch.tensor(case[name], dtype=torch.float32))

    def forward(self, motion, commands, q, measured):
        """Scalar from (B, k+1, n) velocities, (B, k+H, n) commands, (B, n) and (B, H, n) configurations."""
        predicted = []
        for step in range(self.horizon):
            x = torch.cat(
                [
                    (motion / self.velocity_limit).flatten(1),
                    commands[:, step : step + self.lags + 1].flatten(1),
                    2.0 * (q - self.lower) / (self.upper - self.lower) - 1.0,
                ],
                dim=1,
            )
            velocity = motion[:, -1] + self.residual_scale * self.network(x)
            q = q + self.dt_s * velocity
            motion = torch.cat([motion[:, 1:], velocity[:, None]], dim=1)
            predicted.append(q)
        return ((torch.stack(predicted, dim=1) - measured) ** 2).sum(dim=-1).mean()


def main() -> None:
    data_file, case_text, mode = sys.argv[1:]
    case = json.loads(case_text)
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    with np.load(data_file) as data:
        q, qd, a = (torch.from_numpy(data[name]) for name in ("q", "qd", "a"))
        starts = torch.from_numpy(data["starts"]).long()
        layers = [(data[f"kernel_{i}"], data[f"bias_{i}"]) for i in range(len(case["hidden"]) + 1)]
    loss_of = OpenLoopLoss(case, layers)
    optimiser = torch.optim.Adam(loss_of.parameters(), lr=case["learning_rate"])
    lags, horizon, batch_size = case["lags"], case["horizon"], case["batch_size"]
    history, acting, future = (
        torch.arange(-lags, 1),
        torch.arange(-lags, horizon),
        torch.arange(1, horizon + 1),
    )
    compiled = torch.compile(loss_of) if mode == "compiled" else loss_of

    def loss_at(batch: torch.Tensor) -> torch.Tensor:
        rows = batch[:, None]
        return compiled(qd[rows + history], a[rows + acting], q[batch], q[rows + future])

    def epoch() -> int:
        batches = starts[torch.randperm(len(starts))].split(batch_size)
        whole = [batch for batch in batches if len(batch) == batch_size]
        for batch in whole:
            optimiser.zero_grad()
            loss_at(batch).backward()
            optimiser.step()
        return len(whole)

    first = loss_at(starts[:batch_size])
    first.backward()
    norm = torch.sqrt(sum((parameter.grad**2).sum() for parameter in loss_of.parameters()))
    epoch()
    print(
        json.dumps({"loss": first.item(), "gradient_norm": norm.item(), "name": torch.__version__}),
        flush=True,
    )
    clock = time.process_time if os.environ.get("SPEED_CLOCK") == "processor" else time.perf_counter
    for line in sys.stdin:
        begin = clock()
        steps = sum(epoch() for _ in range(int(line)))
        print(json.dumps({"per_second": steps / (clock() - begin)}), flush=True)


if __name__ == "__main__":
    main()
