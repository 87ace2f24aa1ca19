#!/usr/bin/env python3
"""Makes tests/fixtures/training: what PyTorch makes of one minibatch.

For a Stable-Baselines3 policy and for a small muscle transformer, written here with torch's own layers after spec/policy.md, the
losses of PPO, OBC, BC and others, their gradients, and the parameters after one step of clipped Adam, each from the same
start; for Stable-Baselines3's soft actor-critic the same of critics, actor, temperature and targets. Weights are sines of their place, so that only results need storing. Run from the repository's root:

    pip install torch==2.2.2 stable-baselines3==2.2.1 gymnasium==0.29.1 'numpy<2'
    python scripts/make_training_fixtures.py
"""

from pathlib import Path

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.utils import polyak_update
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

OUT = Path("tests/fixtures/training")
WIDTH, HEADS, FEED_FORWARD, LAYERS, LAGS, VOCABULARY = 8, 2, 12, 2, 3, 9
BATCH, LEARNING_RATE, CLIP, LARGEST_NORM = 6, 1e-3, 0.3, 0.7

# Coefficients: policy gradient, entropy, value, imitation; how the imitation is measured.
RECIPES = {
    "ppo": (1.0, 1e-2, 0.5, 0.0, "sample"),
    "obc": (0.0, 0.0, 0.5, 1.0, "sample"),
    "obc_ppo": (1.0, 1e-6, 0.5, 1.0, "all"),
    "density": (0.0, 0.0, 0.5, 1.0, "density"),
}
# The loss of BC is that of OBC: the two differ in whose actions the body is moved by.


def wave(count, seed, scale=1.0):
    return (scale * np.sin(0.61 * np.arange(count) + seed)).astype(np.float32)


def set_waves(names, tensors, first=0):
    """The start: sines, and ones more where a norm multiplies."""
    with torch.no_grad():
        for seed, (name, tensor) in enumerate(zip(names, tensors), first):
            offset = 1.0 if "norm" in name and name.endswith("weight") else 0.0
            tensor.copy_(torch.from_numpy(offset + wave(tensor.numel(), seed, 0.3)).view(tensor.shape))
            if "embedding" in name:
                tensor[0] = 0.0


class Mlp:
    """Stable-Baselines3's own policy."""

    observation, actions = 5, 4

    def __init__(self):
        box = lambda n: gymnasium.spaces.Box(-np.inf, np.inf, (n,), np.float32)
        architecture = dict(pi=[7, 6], vf=[8])
        self.policy = ActorCriticPolicy(box(self.observation), box(self.actions), lambda _: 1.0, net_arch=architecture)
        named = dict(self.policy.named_parameters())
        self.names, self.tensors = list(named), list(named.values())
        set_waves(self.names, self.tensors)

    def lengths(self, row):
        return self.observation, self.actions, self.actions

    def forward(self, batch):
        observations = torch.from_numpy(np.stack(batch["observation"]))
        distribution = self.policy.get_distribution(observations).distribution
        return distribution.mean, distribution.stddev, self.policy.predict_values(observations).flatten()


class Network(nn.Module):
    """The muscle transformer; names as in a checkpoint."""

    def __init__(self):
        super().__init__()
        self.log_std = nn.Parameter(torch.zeros(()))
        self.features_extractor = nn.Module()
        self.features_extractor.tokenizer = nn.Linear(LAGS, WIDTH)
        self.features_extractor.positional_encoder = nn.Module()
        self.features_extractor.positional_encoder.embedding = nn.Embedding(VOCABULARY, WIDTH, padding_idx=0)
        options = dict(dim_feedforward=FEED_FORWARD, dropout=0.0, batch_first=True, norm_first=True)
        norm = nn.LayerNorm(WIDTH)
        stacks = nn.Module()
        encoder, decoder = nn.TransformerEncoderLayer(WIDTH, HEADS, **options), nn.TransformerDecoderLayer(WIDTH, HEADS, **options)
        stacks.encoder = nn.TransformerEncoder(encoder, LAYERS, nn.LayerNorm(WIDTH), enable_nested_tensor=False)
        stacks._action_decoder = nn.TransformerDecoder(decoder, LAYERS, norm)
        stacks._value_decoder = nn.TransformerDecoder(decoder, LAYERS, norm)
        self.mlp_extractor = stacks
        self.action_net, self.log_std_net = nn.Sequential(nn.Linear(WIDTH, 1)), nn.Sequential(nn.Linear(WIDTH, 1))
        self.value_net = nn.Sequential(nn.Identity(), nn.Linear(WIDTH, 1))

    def forward(self, windows, sensors, muscles, token_mask, action_mask):
        words = self.features_extractor.positional_encoder.embedding
        memory = self.mlp_extractor.encoder(
            self.features_extractor.tokenizer(windows) + words(sensors).sum(-2), src_key_padding_mask=token_mask
        )
        y = self.mlp_extractor._action_decoder(
            words(muscles).sum(-2), memory, tgt_key_padding_mask=action_mask, memory_key_padding_mask=token_mask
        )
        ask = words(torch.ones(len(windows), 1, dtype=torch.long))
        v = self.mlp_extractor._value_decoder(ask, memory, memory_key_padding_mask=token_mask)
        return self.action_net(y)[..., 0], self.log_std_net(y.detach())[..., 0], self.value_net(v)[:, 0, 0]


class Transformer:
    """Two tasks, the second smaller and padded, as published, to the larger."""

    tasks = [(7, 5), (4, 2)]

    def __init__(self, over_batch):
        self.network, self.over_batch = Network(), over_batch
        # The optimiser's order: each tensor once, value decoder without its norm.
        named = dict(self.network.named_parameters())
        self.names, self.tensors = list(named), list(named.values())
        set_waves(self.names, self.tensors)

    def lengths(self, row):
        tokens, muscles = self.tasks[row % 2]
        return tokens * LAGS, muscles, self.tasks[0][1]

    def words(self, count, most):
        ids = torch.zeros(most, 3, dtype=torch.long)
        for i in range(count):
            for k in range(i % 3 + 1):
                ids[i, k] = 2 + (i * 5 + k * 3) % 7
        return ids

    def forward(self, batch):
        most_tokens, most_muscles = self.tasks[0]
        rows = range(len(batch["observation"]))
        windows = torch.zeros(len(rows), most_tokens, LAGS)
        sensors, muscles, token_mask, action_mask = [], [], [], []
        for row in rows:
            tokens, count = self.tasks[row % 2]
            windows[row, :tokens] = torch.from_numpy(batch["observation"][row]).view(tokens, LAGS)
            sensors.append(self.words(tokens, most_tokens))
            muscles.append(self.words(count, most_muscles))
            token_mask.append(torch.arange(most_tokens) >= tokens)
            action_mask.append(torch.arange(most_muscles) >= count)
        stacked = [torch.stack(x) for x in (sensors, muscles, token_mask, action_mask)]
        mean, logits, value = self.network(windows, *stacked)
        spread = torch.exp(torch.softmax(logits, -1))
        average = spread.mean() if self.over_batch else spread.mean(-1, keepdim=True)
        return mean, torch.exp(self.network.log_std) * spread / average, value


def make_batch(model):
    """Samples; the last entries of an action may be padding, which no expert knows."""
    batch = {name: [] for name in ("observation", "action", "expert_action", "noise")}
    for row in range(BATCH):
        observation, muscles, action = model.lengths(row)
        for name, length, seed in (("observation", observation, 10), ("action", action, 20), ("expert_action", muscles, 30), ("noise", action, 40)):
            batch[name].append(wave(length, seed + row, 1.0))
    batch["advantage"], batch["value_target"] = wave(BATCH, 3.0), wave(BATCH, 4.0)
    with torch.no_grad():
        mean, sigma, _ = model.forward(batch)
        action = torch.from_numpy(np.stack(batch["action"]))
        density = torch.distributions.Normal(mean, sigma).log_prob(action).sum(-1)
    # Ratios around one, two of them beyond the clipping.
    batch["old_log_probability"] = density.numpy() + np.array([0.1, -0.1, 0.6, -0.6, 0.05, 0.0], np.float32)
    return batch


def losses(model, batch, recipe):
    policy_gradient, entropy, value, imitation, kind = recipe
    mean, sigma, values = model.forward(batch)
    distribution = torch.distributions.Normal(mean, sigma)
    tensor = lambda name: torch.from_numpy(np.asarray(batch[name]))
    advantage = tensor("advantage")
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    action = torch.from_numpy(np.stack(batch["action"]))
    ratio = torch.exp(distribution.log_prob(action).sum(-1) - tensor("old_log_probability"))
    surrogate = -torch.min(advantage * ratio, advantage * torch.clamp(ratio, 1 - CLIP, 1 + CLIP)).mean()
    entropy_loss = -distribution.entropy().sum(-1).mean()
    value_loss = nn.functional.mse_loss(tensor("value_target"), values)
    expert = torch.zeros_like(mean)
    valid = torch.zeros_like(mean)
    for row, numbers in enumerate(batch["expert_action"]):
        expert[row, : len(numbers)] = torch.from_numpy(numbers)
        valid[row, : len(numbers)] = 1.0
    drawn = mean + sigma * torch.from_numpy(np.stack(batch["noise"]))
    squares = valid * (drawn - expert) ** 2
    imitation_loss = {
        "sample": lambda: (squares.sum(-1) / valid.sum(-1)).sum(),
        "all": lambda: squares.sum() / valid.sum(),
        "density": lambda: -distribution.log_prob(expert).sum(),
    }[kind]()
    total = policy_gradient * surrogate + entropy * entropy_loss + value * value_loss + imitation * imitation_loss
    return total, [surrogate, value_loss, entropy_loss, imitation_loss]


def record(name, make):
    stored, start = {}, make()
    names = "".join(f"{n} {list(t.shape)}\n" for n, t in zip(start.names, start.tensors))
    (OUT / f"{type(start).__name__.lower()}.txt").write_text(names)
    for recipe, coefficients in RECIPES.items():
        model = make()
        batch = make_batch(model)
        optimiser = torch.optim.Adam(model.tensors, lr=LEARNING_RATE, eps=1e-5)
        total, parts = losses(model, batch, coefficients)
        optimiser.zero_grad()
        total.backward()
        gradients = [torch.zeros_like(t) if t.grad is None else t.grad.clone() for t in model.tensors]
        nn.utils.clip_grad_norm_(model.tensors, LARGEST_NORM)
        before = [t.detach().clone() for t in model.tensors]
        optimiser.step()
        flat = lambda tensors: torch.cat([t.detach().flatten() for t in tensors]).numpy()
        stored[f"{recipe}_losses"] = np.array([x.item() for x in [total, *parts]])
        stored[f"{recipe}_gradient"] = flat(gradients)
        stored[f"{recipe}_step"] = flat(model.tensors) - flat(before)
        stored["old_log_probability"] = batch["old_log_probability"]
    np.savez(OUT / f"{name}.npz", **stored)


def record_soft():
    """One update of Stable-Baselines3's soft actor-critic, in its order, with given noise."""
    states, actions, discount, rate = 5, 3, 0.99, 0.005
    spaces = [gymnasium.spaces.Box(-1, 1, (n,), np.float32) for n in (states, actions)]
    policy = SACPolicy(*spaces, lambda _: LEARNING_RATE, net_arch=[7, 6])
    parts = {"actor": policy.actor, "critic": policy.critic, "target": policy.critic_target}
    named = {part: dict(module.named_parameters()) for part, module in parts.items()}
    for first, part in zip((0, 20, 40), parts):
        set_waves(named[part], named[part].values(), first)
    log_temperature = torch.tensor([-0.5], requires_grad=True)
    names = {part: "".join(f"{part}.{n} {list(t.shape)}\n" for n, t in named[part].items()) for part in ("actor", "critic")}
    (OUT / "soft.txt").write_text(names["actor"] + names["critic"])
    rows = lambda length, seed: torch.from_numpy(np.stack([wave(length, seed + row) for row in range(BATCH)]))
    state, next_state, action = rows(states, 10), rows(states, 20), 0.9 * rows(actions, 30)
    noise, next_noise = rows(actions, 40), rows(actions, 50)
    reward, goes_on = torch.from_numpy(wave(BATCH, 3.0)).view(-1, 1), torch.ones(BATCH, 1)
    goes_on[2] = 0.0

    def draw(state, noise):
        mean, log_deviation, _ = policy.actor.get_action_dist_params(state)
        distribution = policy.actor.action_dist.proba_distribution(mean, log_deviation)
        gaussian = mean + torch.exp(log_deviation) * noise
        return torch.tanh(gaussian), distribution.log_prob(torch.tanh(gaussian), gaussian).view(-1, 1)

    adam = lambda tensors: torch.optim.Adam(tensors, lr=LEARNING_RATE)
    actor, critic = list(named["actor"].values()), list(named["critic"].values())
    optimisers = adam(actor), adam(critic), adam([log_temperature])
    flat = lambda tensors: torch.cat([t.detach().flatten() for t in tensors]).numpy().copy()
    drawn, density = draw(state, noise)
    temperature = torch.exp(log_temperature.detach())
    temperature_loss = -(log_temperature * (density - actions).detach()).mean()
    optimisers[2].zero_grad()
    temperature_loss.backward()
    optimisers[2].step()
    with torch.no_grad():
        next_action, next_density = draw(next_state, next_noise)
        worth = torch.min(torch.cat(policy.critic_target(next_state, next_action), 1), 1, keepdim=True)[0]
        wanted = reward + goes_on * discount * (worth - temperature * next_density)
    critic_loss = 0.5 * sum(nn.functional.mse_loss(q, wanted) for q in policy.critic(state, action))
    optimisers[1].zero_grad()
    critic_loss.backward()
    stored = {"critic_gradient": flat(t.grad for t in critic)}
    before = flat(critic)
    optimisers[1].step()
    stored["critic_step"] = flat(critic) - before
    judged = torch.min(torch.cat(policy.critic(state, drawn), 1), 1, keepdim=True)[0]
    actor_loss = (temperature * density - judged).mean()
    optimisers[0].zero_grad()
    actor_loss.backward()
    stored["actor_gradient"] = flat(t.grad for t in actor)
    before = flat(actor)
    optimisers[0].step()
    stored["actor_step"] = flat(actor) - before
    polyak_update(policy.critic.parameters(), policy.critic_target.parameters(), rate)
    stored["target"] = flat(policy.critic_target.parameters())
    stored["log_temperature"] = log_temperature.detach().numpy()
    stored["losses"] = np.array([x.mean().item() for x in (critic_loss, actor_loss, density)])
    np.savez(OUT / "soft.npz", **stored)


OUT.mkdir(parents=True, exist_ok=True)
record_soft()
record("mlp", Mlp)
record("transformer", lambda: Transformer(over_batch=False))
record("transformer_over_batch", lambda: Transformer(over_batch=True))
