#!/usr/bin/env python3
"""Makes the small expert policies in tests/fixtures/experts, with what they answer.

Every file is saved by the library that owns its format, with random weights of tiny networks. Beside each policy lies
`<name>_io.npz`: inputs, and the outputs of that library (or, where the published code is in no package, of the formula
in spec/policy.md, evaluated here with torch or NumPy). Run from the repository's root:

    pip install torch==2.2.2 stable-baselines3==2.2.1 sb3-contrib==2.2.1 gymnasium==0.29.1 'numpy<2' scikit-learn mujoco==3.17.0
    python scripts/make_expert_fixtures.py
"""

import io
import json
import pickle
import sys
import types
import zipfile
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from sb3_contrib import RecurrentPPO
from sklearn.preprocessing import StandardScaler
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

OUT = Path("tests/fixtures/experts")
# Attributes whose pickles name places on this machine or are large; readers never decode them.
NOT_SAVED = ["clip_range", "lr_schedule", "_last_obs", "_last_original_obs", "ep_info_buffer", "_last_lstm_states"]
random = np.random.default_rng(20221122)


class Body(gymnasium.Env):
    """An environment that has sizes and nothing else."""

    def __init__(self, observations, actions, windows=None):
        box = lambda shape: gymnasium.spaces.Box(-np.inf, np.inf, shape, np.float32)
        self.observation_space = box((observations,)) if windows is None else gymnasium.spaces.Dict(
            {"env_id": box((1, 1)), "obs": box(windows)}
        )
        self.action_space = gymnasium.spaces.Box(-1, 1, (actions,), np.float32)

    def reset(self, seed=None, options=None):
        return self.observation_space.sample(), {}

    def step(self, action):
        return self.observation_space.sample(), 0.0, False, False, {}


def vector(observations, actions, windows=None):
    return DummyVecEnv([lambda: Body(observations, actions, windows)])


def scramble(policy):
    """Weights far from their initial values, so that every tensor matters."""
    with torch.no_grad():
        for parameter in policy.parameters():
            values = random.normal(0, 0.5, tuple(parameter.shape)).astype(np.float32)
            parameter.copy_(torch.from_numpy(values))


def normaliser(venv, name):
    """A VecNormalize that has seen 500 observations, saved as `<name>.pkl`."""
    wrapped = VecNormalize(venv)
    size = venv.observation_space.shape[0]
    wrapped.obs_rms.update(random.normal(0.3, 2.0, (500, size)))
    wrapped.save(OUT / f"{name}.pkl")
    return wrapped


def save(model, name):
    model.save(OUT / f"{name}.zip", exclude=NOT_SAVED)


def arrays(name, **content):
    single = {key: np.asarray(value) for key, value in content.items()}
    floats = {key: value.astype(np.float32) if value.dtype == np.float64 else value for key, value in single.items()}
    np.savez(OUT / f"{name}_io.npz", **floats)


# ---- perceptrons -----------------------------------------------------------------------------------------------------


def perceptron(name, observations=5, actions=3, **settings):
    venv = vector(observations, actions)
    model = PPO("MlpPolicy", venv, n_steps=8, batch_size=8, device="cpu", **settings)
    scramble(model.policy)
    statistics = normaliser(venv, f"{name}_vecnormalize")
    raw = random.normal(0.3, 3.0, (20, observations)).astype(np.float32)
    inputs = statistics.normalize_obs(raw)
    with torch.no_grad():
        tensor = torch.as_tensor(inputs)
        distribution = model.policy.get_distribution(tensor)
        means = distribution.distribution.mean
        deviations = distribution.distribution.stddev
    clipped = model.predict(inputs, deterministic=True)[0]
    save(model, name)
    content = dict(obs=raw, mean=means, clipped=clipped, deviation=deviations)
    if model.use_sde:
        # The noise matrix as this project draws it: row-major, standard normal, then scaled.
        draws = random.normal(size=(distribution.latent_sde_dim, actions)).astype(np.float32)
        with torch.no_grad():
            matrix = torch.as_tensor(draws) * distribution.get_std(model.policy.log_std)
            latent = model.policy.mlp_extractor.forward_actor(tensor)
            content |= dict(draws=draws, sample=means + latent @ matrix)
    arrays(name, **content)


class SubspacePolicy(ActorCriticPolicy):
    """spec/policy.md §2.4: two more tensors, which act on the mean."""

    def _build(self, lr_schedule):
        actions = self.action_space.shape[0]
        self.projection = torch.nn.Parameter(torch.eye(actions), requires_grad=False)
        self.mean = torch.nn.Parameter(torch.zeros(actions), requires_grad=False)
        super()._build(lr_schedule)

    def project(self, mean, rows):
        P = self.projection[:rows]
        inverse = torch.inverse(P @ P.T + 1e-6 * torch.eye(P.shape[0]))
        return self.mean + (mean - self.mean) @ P.T @ inverse @ P


def subspace():
    observations, actions = 6, 4
    venv = vector(observations, actions)
    settings = dict(net_arch=dict(pi=[8, 8], vf=[8, 8]), activation_fn=torch.nn.ReLU)
    model = PPO(SubspacePolicy, venv, n_steps=8, batch_size=8, device="cpu", policy_kwargs=settings)
    scramble(model.policy)
    with torch.no_grad():
        # Neither orthogonal nor of unit length: fine-tuning leaves it so.
        model.policy.projection.copy_(torch.from_numpy(random.normal(0, 1, (actions, actions)).astype(np.float32)))
    statistics = normaliser(venv, "subspace_vecnormalize")
    raw = random.normal(0.3, 3.0, (20, observations)).astype(np.float32)
    with torch.no_grad():
        free = model.policy.get_distribution(torch.as_tensor(statistics.normalize_obs(raw))).distribution.mean
        projected = {f"mean_{rows}": model.policy.project(free, rows) for rows in (1, 2, 4)}
    model.save(OUT / "subspace.zip", exclude=[*NOT_SAVED, "policy_class"])
    arrays("subspace", obs=raw, free=free, **projected)


# ---- multi-task perceptrons ------------------------------------------------------------------------------------------


class OnlyObservation(BaseFeaturesExtractor):
    """Reads the padded matrix and nothing else."""

    __module__ = "padded"

    def __init__(self, space):
        super().__init__(space, int(np.prod(space["obs"].shape)))

    def forward(self, observation):
        return observation["obs"].flatten(1)


sys.modules["padded"] = types.ModuleType("padded")
sys.modules["padded"].OnlyObservation = OnlyObservation


def shim(name, **classes):
    """A module called `name` whose classes pickle under that name."""
    module = types.ModuleType(name)
    for part in range(1, len(name.split("."))):
        sys.modules.setdefault(".".join(name.split(".")[:part]), types.ModuleType("package"))
    for class_name in classes:
        setattr(module, class_name, type(class_name, (), {"__module__": name}))
    sys.modules[name] = module
    return module


def signature_normaliser(path, signatures, lags):
    """spec/policy.md §3.6, with the attributes that are read."""
    multi = shim("envs.multi_env", FlexibleMultiVecNormalize=None)
    moments = shim("envs.running_mean_std", SpecsRunningMeanStd=None).SpecsRunningMeanStd()
    rows = len(signatures)
    mean = random.normal(0, 1, (rows, lags)).astype(np.float32)
    variance = random.uniform(0.5, 4, (rows, lags)).astype(np.float32)
    mean[0], variance[0] = 0, 1
    keys = [tuple(np.float32(word) for word in signature) for signature in signatures]
    moments.__dict__.update(
        sig_ids_dict={key: row for row, key in enumerate(keys)},
        mean_mat=mean, var_mat=variance, count_mat=np.full(rows, 1e7), epsilon=1e-4,
    )
    top = multi.FlexibleMultiVecNormalize()
    top.__dict__.update(
        obs_rms=moments, norm_obs=True, norm_reward=True, training=False, clip_obs=10.0, clip_reward=10.0,
        gamma=0.99, epsilon=1e-8, num_envs=1, env_ids_vec=["Small"], env_id_set={"Small"},
    )
    path.write_bytes(pickle.dumps(top, protocol=4))
    return mean, variance


def multi_task(name, algorithm, **settings):
    """A body of five sensors and two muscles, played by a policy made for nine and three."""
    padded, lags, padded_actions, sensors, muscles = 9, 3, 3, 5, 2
    words = [[3], [4, 130], [5], [3], [6]]
    venv = vector(0, padded_actions, (padded, lags))
    extractor = dict(features_extractor_class=OnlyObservation)
    if algorithm is SAC:
        extractor["n_critics"] = 1
    architecture = dict(net_arch=[8, 8], **extractor)
    model = algorithm("MultiInputPolicy", venv, device="cpu", policy_kwargs=architecture, **settings)
    scramble(model.policy)
    signatures = [[0], [3], [4, 130], [5], [6]]
    mean, variance = signature_normaliser(OUT / f"{name}_vecnormalize.pkl", signatures, lags)
    raw = random.normal(0.3, 2.0, (12, sensors)).astype(np.float32)
    windows = np.zeros((len(raw), padded, lags), np.float32)
    rows = [signatures.index(sorted(word)) for word in words]
    for step in range(len(raw)):
        for lag in range(lags):
            at = step - (lags - 1 - lag)
            value = raw[at] if at >= 0 else np.zeros(sensors, np.float32)
            scaled = (value - mean[rows, lag]) / np.sqrt(variance[rows, lag] + 1e-8)
            windows[step, :sensors, lag] = np.clip(scaled, -10, 10)
    observation = {"obs": torch.as_tensor(windows), "env_id": torch.zeros(len(raw), 1, 1)}
    action = model.predict({key: value.numpy() for key, value in observation.items()}, deterministic=True)[0]
    content = dict(obs=raw, clipped=action[:, :muscles])
    with torch.no_grad():
        if algorithm is SAC:
            before, log_deviation, _ = model.policy.actor.get_action_dist_params(observation)
            draws = random.normal(size=before.shape).astype(np.float32)
            sample = torch.tanh(before + log_deviation.exp() * torch.as_tensor(draws))
            content |= dict(mean=torch.tanh(before)[:, :muscles], deviation=log_deviation.exp()[:, :muscles],
                            draws=draws[:, :muscles], sample=sample[:, :muscles])
        else:
            distribution = model.policy.get_distribution(observation).distribution
            content |= dict(mean=distribution.mean[:, :muscles], deviation=distribution.stddev[:, :muscles])
    save(model, name)
    arrays(name, **content)


# ---- recurrent policies ----------------------------------------------------------------------------------------------


def recurrent_model(observations, actions, **settings):
    venv = vector(observations, actions)
    model = RecurrentPPO("MlpLstmPolicy", venv, n_steps=8, batch_size=8, device="cpu", **settings)
    scramble(model.policy)
    return venv, model


def play_recurrent(model, inputs, starts):
    """Means, values and latents step by step, as `predict` steps."""
    policy, means, values, latents = model.policy, [], [], []
    shape = (policy.lstm_actor.num_layers, 1, policy.lstm_actor.hidden_size)
    actor = critic = (torch.zeros(shape), torch.zeros(shape))
    with torch.no_grad():
        for row, start in zip(inputs, starts):
            observation, start = torch.as_tensor(row[None]), torch.tensor([float(start)])
            latent, next_actor = policy._process_sequence(observation, actor, start, policy.lstm_actor)
            if policy.lstm_critic is not None:
                value_latent, critic = policy._process_sequence(observation, critic, start, policy.lstm_critic)
            elif policy.shared_lstm:
                value_latent = latent
            else:
                value_latent = policy.critic(observation)
            actor = next_actor
            latent = policy.mlp_extractor.forward_actor(latent)
            latents.append(latent[0])
            means.append(policy.action_net(latent)[0])
            values.append(policy.value_net(policy.mlp_extractor.forward_critic(value_latent))[0])
    return torch.stack(means), torch.stack(values), torch.stack(latents)


def recurrent(name, observations=5, actions=3, **settings):
    venv, model = recurrent_model(observations, actions, **settings)
    statistics = normaliser(venv, f"{name}_vecnormalize")
    raw = random.normal(0.3, 3.0, (16, observations)).astype(np.float32)
    starts = np.array([step in (0, 9) for step in range(len(raw))])
    means, values, _ = play_recurrent(model, statistics.normalize_obs(raw), starts)
    # The library's own `predict` must agree with the stepping above.
    state = None
    for row, start, mean in zip(statistics.normalize_obs(raw), starts, means):
        action, state = model.predict(row[None], state, np.array([start]), deterministic=True)
        np.testing.assert_allclose(action[0], mean.clamp(-1, 1), atol=2e-6)
    save(model, name)
    arrays(name, obs=raw, start=starts.astype(np.float32), mean=means, value=values)


def expln(x, epsilon=1e-6):
    return np.where(x <= 0, np.exp(x), np.log1p(np.maximum(x, 0) + epsilon) + 1)


def lattice(name, shape, settings):
    """spec/policy.md §4.3. No package of that name is published with these versions: the formula is evaluated here."""
    observations, actions, width = 5, 3, 6
    architecture = dict(net_arch=dict(pi=[width], vf=[width]), activation_fn=torch.nn.ReLU, lstm_hidden_size=4)
    venv, model = recurrent_model(observations, actions, policy_kwargs=architecture)
    log_deviation = random.normal(-0.5, 0.6, shape).astype(np.float32)
    model.policy.log_std = torch.nn.Parameter(torch.as_tensor(log_deviation))
    model.policy_kwargs = {**model.policy_kwargs, "use_lattice": True, **settings}
    model.use_sde, model.sde_sample_freq = len(shape) == 2, 4
    statistics = normaliser(venv, f"{name}_vecnormalize")
    raw = random.normal(0.3, 3.0, (10, observations)).astype(np.float32)
    means, _, latents = play_recurrent(model, statistics.normalize_obs(raw), [step == 0 for step in range(len(raw))])
    W = model.policy.action_net.weight.detach().numpy().astype(np.float64)
    mean, phi = means.numpy().astype(np.float64), latents.numpy().astype(np.float64)
    if len(shape) == 1:
        scale = np.exp(log_deviation.astype(np.float64)) * np.exp(settings.get("log_std_init", 0.0))
        draws = random.normal(size=(len(raw), actions + width))
        noise = draws * scale
        sample = mean + noise[:, :actions] + noise[:, actions:] @ W.T
        covariance = (W * scale[actions:] ** 2) @ W.T + np.diag(scale[:actions] ** 2)
        deviation = np.broadcast_to(np.sqrt(np.diag(covariance)), mean.shape)
    else:
        low, high = settings.get("std_clip", (1e-3, 10.0))
        clipped = np.clip(log_deviation.astype(np.float64), np.log(low), np.log(high)) - 0.5 * np.log(width)
        deviations = expln(clipped) if settings.get("use_expln") else np.exp(clipped)
        if shape[1] == 2:
            correlated, independent = np.repeat(deviations[:, :1], width, 1), np.repeat(deviations[:, 1:], actions, 1)
        else:
            correlated, independent = deviations[:, :width], deviations[:, width:]
        alpha, regulariser = settings.get("alpha", 1.0), settings.get("std_reg", 0.0)
        redrawn = -(-len(raw) // model.sde_sample_freq)
        draws = random.normal(size=(redrawn, width * (width + actions)))
        sample = np.empty_like(mean)
        for step in range(len(raw)):
            drawn = draws[step // model.sde_sample_freq]
            M_correlated = drawn[: width * width].reshape(width, width) * correlated
            M_independent = drawn[width * width :].reshape(width, actions) * independent
            sample[step] = mean[step] + alpha * (phi[step] @ M_correlated) @ W.T + phi[step] @ M_independent
        v, w = phi**2 @ correlated**2, phi**2 @ independent**2 + regulariser**2
        deviation = np.sqrt(alpha**2 * v @ (W**2).T + w)
    save(model, name)
    arrays(name, obs=raw, mean=means, deviation=deviation, draws=draws.reshape(-1), sample=sample)


# ---- files that hold only a policy -----------------------------------------------------------------------------------


def policy_only():
    """The members of an archive as loose files, and what `policy.save` writes."""
    settings = dict(net_arch=dict(pi=[6], vf=[6]), activation_fn=torch.nn.ReLU, lstm_hidden_size=4)
    venv, model = recurrent_model(5, 3, policy_kwargs=settings)
    folder = OUT / "loose"
    folder.mkdir(exist_ok=True)
    buffer = io.BytesIO()
    model.save(buffer, exclude=NOT_SAVED)
    archive = zipfile.ZipFile(buffer)
    (folder / "policy.pth").write_bytes(archive.read("policy.pth"))
    (folder / "sb3_data.json").write_bytes(archive.read("data"))
    statistics = normaliser(venv, "loose/env")
    raw = random.normal(0.3, 3.0, (8, 5)).astype(np.float32)
    means, _, _ = play_recurrent(model, statistics.normalize_obs(raw), [step == 0 for step in range(len(raw))])
    arrays("loose/policy", obs=raw, mean=means)
    torch.save({"state_dict": model.policy.state_dict(), "data": {"use_sde": False}}, OUT / "state_dict_and_data.pth")
    model.policy.save(OUT / "policy_save.pth")


# ---- walking ---------------------------------------------------------------------------------------------------------


def walking():
    """spec/policy.md §4.4, with the library's own muscle functions."""
    observations, muscles = 7, 4
    widths = [16, 12, 10, 10, 8, 8]
    tensor = lambda *shape: torch.as_tensor(random.normal(0, 0.6, shape).astype(np.float32))
    state = {
        "norm.n": torch.tensor(1000),
        "norm.mean": tensor(observations),
        "norm.var": torch.ones(observations),
        "norm.std": tensor(observations).abs() + 0.5,
    }
    before = observations
    for layer, width in enumerate(widths):
        state[f"net.affine_layers.{layer}.weight"] = tensor(width, before)
        state[f"net.affine_layers.{layer}.bias"] = tensor(width)
        before = width
    state |= {
        "action_mean.weight": tensor(muscles, before) * 0.1,
        "action_mean.bias": torch.full((muscles,), 0.25),
        "log_std": tensor(1, muscles + before),
    }
    file = {"policy": state, "value": {"value_head.weight": tensor(1, 3)}, "epoch": 7, "frame": 9,
            "optimizer_policy": {"state": {}, "param_groups": [{"lr": 1e-3, "params": [0]}]}}
    torch.save(file, OUT / "walking.pth")

    raw = random.normal(0, 1.5, (30, observations)).astype(np.float32)
    x = (torch.as_tensor(raw) - state["norm.mean"]) / (state["norm.std"] + 1e-8)
    x = x.clamp(-5, 5)
    for layer in range(len(widths)):
        x = torch.nn.functional.silu(torch.nn.functional.linear(
            x, state[f"net.affine_layers.{layer}.weight"], state[f"net.affine_layers.{layer}.bias"]))
    mean = torch.nn.functional.linear(x, state["action_mean.weight"], state["action_mean.bias"])

    # Range, force, scale, lmin, lmax, vmax, fpmax, fvmax: MuJoCo's defaults, one muscle with its force from the scale.
    parameters = np.tile([0.75, 1.05, 800.0, 200.0, 0.5, 1.6, 1.5, 1.3, 1.2], (muscles, 1))
    parameters[1, 2], parameters[2, 2], parameters[3, :2] = 350.0, -1.0, (0.6, 1.2)
    length_range = np.sort(random.uniform(0.15, 0.45, (muscles, 2)), 1) + [[0, 0.05]]
    acc0 = random.uniform(0.5, 4.0, muscles)
    length = random.uniform(0.1, 0.5, (len(raw), muscles)).astype(np.float32)
    velocity = random.normal(0, 0.3, (len(raw), muscles)).astype(np.float32)
    gain, bias, actions = (np.empty((len(raw), muscles)) for _ in range(3))
    for step in range(len(raw)):
        for m in range(muscles):
            l, v, target = float(length[step, m]), float(velocity[step, m]), float(mean[step, m].clamp(-1, 1))
            gain[step, m] = mujoco.mju_muscleGain(l, v, length_range[m], acc0[m], parameters[m])
            bias[step, m] = mujoco.mju_muscleBias(l, length_range[m], acc0[m], parameters[m])
            peak = parameters[m, 2]
            force = np.clip(5 * peak * (target - l) - 0.5 * peak * v, -peak, 0.0)
            activation = np.clip((force - bias[step, m]) / min(-1.0, gain[step, m]), 0, 1)
            activation = np.clip(activation, 0.0005527786369235996, 0.9241418199787566)
            actions[step, m] = 0.5 - 0.2 * np.log(1 / activation - 1)
    np.savez(OUT / "walking_io.npz", obs=raw, mean=mean.numpy(), parameters=parameters, length_range=length_range,
             acc0=acc0, length=length, velocity=velocity, gain=gain, bias=bias, action=actions.astype(np.float32))


# ---- ensemble with classifier ----------------------------------------------------------------------------------------


def ensemble():
    """spec/policy.md §4.6 with two networks a group."""
    folder = OUT / "ensemble"
    observations, actions = 50, 2
    groups = {}
    for group in ("base", "hold"):
        (folder / group).mkdir(parents=True, exist_ok=True)
        groups[group] = []
        for steps in (1000, 2000):
            settings = dict(net_arch=dict(pi=[], vf=[]), activation_fn=torch.nn.ReLU, lstm_hidden_size=3)
            venv, model = recurrent_model(observations, actions, policy_kwargs=settings)
            statistics = normaliser(venv, f"ensemble/{group}/rl_model_vecnormalize_{steps}_steps")
            save(model, f"ensemble/{group}/rl_model_{steps}_steps")
            groups[group].append((model, statistics))
    scaler = StandardScaler().fit(random.normal(0.4, 2.0, (60, 13 * 18)))
    (folder / "scaler.pkl").write_bytes(pickle.dumps(scaler, protocol=4))
    layers = torch.nn.ModuleDict({"layer_1": torch.nn.Linear(234, 8), "layer_2": torch.nn.Linear(8, 6), "layer_out": torch.nn.Linear(6, 1)})

    def probability(slices):
        x = torch.as_tensor(scaler.transform(np.concatenate(slices)[None]).astype(np.float32))
        x = torch.relu(layers["layer_2"](torch.relu(layers["layer_1"](x))))
        return torch.sigmoid(layers["layer_out"](x)).item()

    def episode(raw):
        group, states, slices, answers, choice = "base", None, [], [], None
        for step, row in enumerate(raw):
            if step <= 12:
                slices.append(row[29:47])
            if step == 12:
                choice = probability(slices)
                if np.round(choice) == 0:
                    group, states = "hold", None
            states = states or [None] * len(groups[group])
            answer = []
            for k, (model, statistics) in enumerate(groups[group]):
                start = np.array([states[k] is None])
                action, states[k] = model.predict(statistics.normalize_obs(row[None]), states[k], start, deterministic=True)
                answer.append(action[0])
            answers.append(np.mean(answer, axis=0))
        return np.array(answers), choice

    # One episode of each kind: the bias of the last layer is set half-way between the two logits.
    episodes = [random.normal(0.3, 2.0, (18, observations)).astype(np.float32) for _ in range(2)]
    with torch.no_grad():
        layers["layer_out"].bias.zero_()
        logits = [np.log(p / (1 - p)) for p in (probability([row[29:47] for row in raw[:13]]) for raw in episodes)]
        layers["layer_out"].weight.mul_(10)
        layers["layer_out"].bias.fill_(-10 * sum(logits) / 2)
        torch.save(layers.state_dict(), folder / "classifier.pt")
        found = {bool(np.round(choice)): (raw, answers, choice)
                 for raw, (answers, choice) in ((raw, episode(raw)) for raw in episodes)}
    arrays("ensemble/classifier", obs_hold=found[False][0], action_hold=found[False][1], obs_base=found[True][0],
           action_base=found[True][1], probability=[found[False][2], found[True][2]])


def main():
    torch.manual_seed(1)
    torch.set_num_threads(1)
    OUT.mkdir(parents=True, exist_ok=True)
    net = lambda pi, vf, **rest: dict(policy_kwargs=dict(net_arch=dict(pi=pi, vf=vf), **rest))
    perceptron("ppo_default", **net([6, 6], [4]))
    perceptron("ppo_elu_uneven", **net([7], [5, 4], activation_fn=torch.nn.ELU))
    perceptron("ppo_no_hidden", **net([], []))
    perceptron("ppo_gelu", **net([7, 6], [4], activation_fn=torch.nn.GELU))
    perceptron("ppo_gsde", use_sde=True, sde_sample_freq=4, **net([7], [4]))
    perceptron("ppo_gsde_narrow", use_sde=True, **net([7], [4], full_std=False, use_expln=True))
    subspace()
    multi_task("multi_task_ppo", PPO, n_steps=8, batch_size=8)
    multi_task("multi_task_sac", SAC, buffer_size=1)
    small = dict(lstm_hidden_size=4)
    recurrent("recurrent_two_layers", **net([6, 5], [4], n_lstm_layers=2, activation_fn=torch.nn.ReLU, **small))
    recurrent("recurrent_shared", **net([6], [5], shared_lstm=True, enable_critic_lstm=False, **small))
    recurrent("recurrent_plain_critic", **net([], [], enable_critic_lstm=False, **small))
    lattice("lattice", (3 + 6,), dict(log_std_init=-0.7))
    lattice("lattice_gsde", (6, 2), dict(use_expln=True, std_clip=[1e-3, 0.9]))
    lattice("lattice_gsde_full", (6, 6 + 3), dict(alpha=0.8, std_reg=0.05, full_std=True))
    policy_only()
    walking()
    ensemble()
    versions = dict(torch=torch.__version__, stable_baselines3=stable_baselines3.__version__,
                    sb3_contrib=sb3_contrib.__version__, gymnasium=gymnasium.__version__, numpy=np.__version__,
                    mujoco=mujoco.__version__)
    (OUT / "versions.json").write_text(json.dumps(versions, indent=2) + "\n")


if __name__ == "__main__":
    main()
