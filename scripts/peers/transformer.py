"""Times the forward pass of the muscle transformer in PyTorch.

Takes one argument, a JSON document with networks, bodies, batches, threads and the seconds to spend on each combination, and prints
one JSON document with the time per observation. Exits with 3 if `torch` is not installed.

The network is written three times. *published* is how the published code calls it: PyTorch's transformer modules with a mask
of padded keys, and the embeddings of the words looked up and summed in every call. *modules* leaves out the masks and computes
those sums once, so that the encoder takes PyTorch's fused path. *functions* does the same with functional operations and fused
attention. The fastest of the three is PyTorch at its best. Weights are random: the time does not depend on them.
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


class Modules(nn.Module):
    """The network from PyTorch's transformer layers."""

    def __init__(self, network, body):
        super().__init__()
        d, heads, hidden, layers = (network[k] for k in ("width", "heads", "feed_forward", "layers"))
        options = dict(dim_feedforward=hidden, dropout=0.0, batch_first=True, norm_first=True)
        self.tokenizer = nn.Linear(network["lags"], d)
        self.vocabulary = nn.Embedding(network["vocabulary"], d)
        self.sensor_words = torch.randint(network["vocabulary"], (body["sensors"], 2))
        self.muscle_words = torch.randint(network["vocabulary"], (body["muscles"], 2))
        self.words = self.vocabulary(self.sensor_words).sum(-2)
        self.queries = self.vocabulary(self.muscle_words).sum(-2)
        self.encoder = nn.ModuleList(nn.TransformerEncoderLayer(d, heads, **options) for _ in range(layers))
        self.encoder_norm = nn.LayerNorm(d)
        self.decoder = nn.ModuleList(nn.TransformerDecoderLayer(d, heads, **options) for _ in range(layers))
        self.decoder_norm = nn.LayerNorm(d)
        self.head = nn.Linear(d, 1)
        self.heads = heads

    def forward(self, windows):
        x = self.tokenizer(windows) + self.words
        for layer in self.encoder:
            x = layer(x)
        memory = self.encoder_norm(x)
        y = self.queries.expand(len(windows), -1, -1)
        for layer in self.decoder:
            y = layer(y, memory)
        return self.head(self.decoder_norm(y)).squeeze(-1)

    def published(self, windows):
        """The same as the published code calls it."""
        batch = len(windows)
        padded_sensors = torch.zeros(batch, len(self.sensor_words), dtype=torch.bool)
        padded_muscles = torch.zeros(batch, len(self.muscle_words), dtype=torch.bool)
        x = self.tokenizer(windows) + self.vocabulary(self.sensor_words.expand(batch, -1, -1)).sum(-2)
        for layer in self.encoder:
            x = layer(x, src_key_padding_mask=padded_sensors)
        memory = self.encoder_norm(x)
        y = self.vocabulary(self.muscle_words.expand(batch, -1, -1)).sum(-2)
        for layer in self.decoder:
            y = layer(y, memory, tgt_key_padding_mask=padded_muscles, memory_key_padding_mask=padded_sensors)
        return self.head(self.decoder_norm(y)).squeeze(-1)

    def functions(self, windows):
        """The same with functional operations."""
        x = self.tokenizer(windows) + self.words
        for layer in self.encoder:
            normed = normalise(layer.norm1, x)
            x = x + attend(layer.self_attn, self.heads, normed, normed)
            x = x + feed_forward(layer, normalise(layer.norm2, x))
        memory = normalise(self.encoder_norm, x)
        y = self.queries.expand(len(windows), -1, -1)
        for layer in self.decoder:
            normed = normalise(layer.norm1, y)
            y = y + attend(layer.self_attn, self.heads, normed, normed)
            y = y + attend(layer.multihead_attn, self.heads, normalise(layer.norm2, y), memory)
            y = y + feed_forward(layer, normalise(layer.norm3, y))
        return self.head(normalise(self.decoder_norm, y)).squeeze(-1)


def normalise(norm, x):
    return F.layer_norm(x, norm.normalized_shape, norm.weight, norm.bias, norm.eps)


def feed_forward(layer, x):
    return F.linear(F.relu(F.linear(x, layer.linear1.weight, layer.linear1.bias)), layer.linear2.weight, layer.linear2.bias)


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
    rows = []
    with torch.inference_mode():
        for network in question["networks"]:
            for body in question["bodies"]:
                model = Modules(network, body).eval()
                for batch in question["batches"]:
                    windows = torch.randn(batch, body["sensors"], network["lags"])
                    ways = {"published": model.published, "modules": model, "functions": model.functions}
                    for way in ways.values():
                        assert torch.allclose(way(windows), model(windows), atol=1e-3)
                    times = {
                        name: 1e3 * best_time(lambda: way(windows), question["seconds"]) / batch
                        for name, way in ways.items()
                    }
                    rows.append({
                        "network": network["name"],
                        "body": body["name"],
                        "batch": batch,
                        "milliseconds": times,
                    })
    print(json.dumps({"version": torch.__version__, "rows": rows}))


main()
