"""Times one training step of the muscle transformer in PyTorch: forward, backward, gradient clipping, Adam.

Takes one argument, a JSON document with networks, the body, the batch, the threads and the seconds to spend on each network,
and prints one JSON document with samples per second. Exits with 3 if `torch` is not installed.

The network is written twice: with PyTorch's own transformer modules, and with functional operations and fused attention.
The faster of the two counts. As a careful author would have it, the sums of word embeddings of the one task are computed once
per step, action and value share one pass forward, and so do the two uses of the action's distribution.
"""

import json
import sys
import time

try:
    import torch
    from torch import nn
    from torch.nn import functional as F
except ImportError:
    sys.exit(3)


class Network(nn.Module):
    def __init__(self, network, body):
        super().__init__()
        d, heads, hidden, layers = (network[k] for k in ("width", "heads", "feed_forward", "layers"))
        options = dict(dim_feedforward=hidden, dropout=0.0, batch_first=True, norm_first=True)
        self.tokenizer = nn.Linear(network["lags"], d)
        self.embedding = nn.Embedding(network["vocabulary"], d, padding_idx=0)
        self.encoder = nn.ModuleList(nn.TransformerEncoderLayer(d, heads, **options) for _ in range(layers))
        self.encoder_norm = nn.LayerNorm(d)
        self.decoders = nn.ModuleList(
            nn.ModuleList(nn.TransformerDecoderLayer(d, heads, **options) for _ in range(layers)) for _ in range(2)
        )
        self.decoder_norm = nn.LayerNorm(d)
        self.mean, self.scale, self.value = nn.Linear(d, 1), nn.Linear(d, 1), nn.Linear(d, 1)
        self.log_std = nn.Parameter(torch.zeros(()))
        self.heads = heads
        self.sensors = torch.tensor(body["sensors"])
        self.muscles = torch.tensor(body["muscles"])

    def forward(self, windows, fused):
        x = self.tokenizer(windows) + self.embedding(self.sensors).sum(1)
        for layer in self.encoder:
            x = self.encode(layer, x) if fused else layer(x)
        memory = self.encoder_norm(x)
        queries = [self.embedding(self.muscles).sum(1), self.embedding.weight[1:2]]
        y, v = (
            self.decoder_norm(self.decode(layers, start.expand(len(windows), -1, -1), memory, fused))
            for layers, start in zip(self.decoders, queries)
        )
        spread = torch.exp(torch.softmax(self.scale(y.detach()).squeeze(-1), -1))
        sigma = torch.exp(self.log_std) * spread / spread.mean()
        return self.mean(y).squeeze(-1), sigma, self.value(v).flatten()

    def encode(self, layer, x):
        normed = layer.norm1(x)
        x = x + attend(layer.self_attn, self.heads, normed, normed)
        return x + feed_forward(layer, layer.norm2(x))

    def decode(self, layers, y, memory, fused):
        for layer in layers:
            if not fused:
                y = layer(y, memory)
                continue
            normed = layer.norm1(y)
            y = y + attend(layer.self_attn, self.heads, normed, normed)
            y = y + attend(layer.multihead_attn, self.heads, layer.norm2(y), memory)
            y = y + feed_forward(layer, layer.norm3(y))
        return y


def feed_forward(layer, x):
    return layer.linear2(F.relu(layer.linear1(x)))


def attend(attention, heads, query, memory):
    d = query.shape[-1]
    weight, bias = attention.in_proj_weight, attention.in_proj_bias
    if query is memory:
        q, k, v = F.linear(query, weight, bias).chunk(3, dim=-1)
    else:
        q = F.linear(query, weight[:d], bias[:d])
        k, v = F.linear(memory, weight[d:], bias[d:]).chunk(2, dim=-1)
    q, k, v = (x.unflatten(-1, (heads, d // heads)).transpose(1, 2) for x in (q, k, v))
    mixed = F.scaled_dot_product_attention(q, k, v).transpose(1, 2).flatten(-2)
    return F.linear(mixed, attention.out_proj.weight, attention.out_proj.bias)


def step(model, optimiser, batch, fused):
    """PPO and imitation together, as in the published minibatch."""
    mean, sigma, value = model(batch["windows"], fused)
    distribution = torch.distributions.Normal(mean, sigma)
    advantage = batch["advantage"]
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    ratio = torch.exp(distribution.log_prob(batch["action"]).sum(-1) - batch["old"])
    surrogate = -torch.min(ratio * advantage, ratio.clamp(0.7, 1.3) * advantage).mean()
    imitation = ((mean + sigma * batch["noise"] - batch["expert"]) ** 2).mean(-1).sum()
    loss = surrogate - 1e-6 * distribution.entropy().sum(-1).mean() + 0.5 * F.mse_loss(value, batch["target"]) + imitation
    optimiser.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(model.parameters(), 0.7)
    optimiser.step()


def best_time(work, seconds):
    work()
    best, start = float("inf"), time.perf_counter()
    while time.perf_counter() - start < seconds or best == float("inf"):
        begin = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begin)
    return best


def main():
    question = json.loads(sys.argv[1])
    torch.set_num_threads(question["threads"])
    torch.manual_seed(0)
    body, count = question["body"], question["batch"]
    muscles = len(body["muscles"])
    rows = []
    for network in question["networks"]:
        batch = {name: torch.randn(count, muscles) for name in ("action", "noise", "expert")}
        batch |= {name: torch.randn(count) for name in ("advantage", "target")}
        batch["old"] = -2.0 * muscles + torch.randn(count)
        batch["windows"] = torch.randn(count, len(body["sensors"]), network["lags"])
        times = {}
        for name, fused in (("modules", False), ("functions", True)):
            model = Network(network, body)
            optimiser = torch.optim.Adam(model.parameters(), lr=1e-4, eps=1e-5)
            times[name] = best_time(lambda: step(model, optimiser, batch, fused), question["seconds"])
        fastest = min(times, key=times.get)
        rows.append({"network": network["name"], "samples_per_second": count / times[fastest], "fastest": fastest})
    print(json.dumps({"version": torch.__version__, "rows": rows}))


main()
