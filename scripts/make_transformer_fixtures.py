"""Makes the small transformer checkpoints in tests/fixtures/transformers, with torch and Stable-Baselines3 themselves.

No published file of these variants can travel with the program, so each is built here from the architecture as it is
described (pre-norm torch layers, summed word embeddings, one linear head per actuator), filled with seeded random
numbers, saved the way the libraries save, and asked for its actions, which are recorded beside it.

    pip install torch==2.2.2 stable-baselines3==2.2.1 "numpy<2"
    python scripts/make_transformer_fixtures.py tests/fixtures/transformers
"""

import json
import pathlib
import pickle
import sys
import types
from collections import OrderedDict

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common import save_util
from torch import nn

WIDTH, HEADS, FEED_FORWARD, LAGS, STEPS = 8, 2, 12, 6, 9
STANDARD = (pathlib.Path(__file__).parent.parent / "tests/fixtures/transformers/words.txt").read_text().split()

SENSORS = [
    ["FDS5", "activation", "muscle"],
    ["FDS5", "force", "muscle"],
    ["hip_flexion", "position", "angular", "joint"],
    ["ball", "id_1", "position", "x"],
    ["ball", "id_2", "error", "y", "target"],
]
MUSCLES = [["FDS5", "activation", "muscle"], ["EIP", "activation", "muscle"], ["soleus", "left", "activation", "muscle"]]


class Extractor(nn.Module):
    """Tokeniser and word embeddings."""

    def __init__(self, encoder):
        super().__init__()
        self.tokenizer = nn.Linear(LAGS, WIDTH)
        self.positional_encoder = encoder


class LearnedWords(nn.Module):
    def __init__(self, words):
        super().__init__()
        self.embedding = nn.Embedding(words, WIDTH, padding_idx=0)

    def rows(self, task):
        return self.embedding.weight


class WaveWords(nn.Module):
    def __init__(self, words):
        super().__init__()
        angle = torch.arange(words)[:, None] * torch.exp(torch.arange(0, WIDTH, 2) * (-np.log(10000.0) / WIDTH))
        table = torch.zeros(words, WIDTH)
        table[:, 0::2], table[:, 1::2] = torch.sin(angle), torch.cos(angle)
        self.register_buffer("embedding", table)

    def rows(self, task):
        return self.embedding


class TaskWords(nn.Module):
    def __init__(self, words, tasks):
        super().__init__()
        tables = {task: nn.Embedding(words, WIDTH, padding_idx=0) for task in tasks}
        self.task_embeddings = nn.ModuleDict(tables)

    def rows(self, task):
        return self.task_embeddings[task].weight


def encoder(layers):
    layer = nn.TransformerEncoderLayer(WIDTH, HEADS, FEED_FORWARD, 0.0, "relu", 1e-5, True, norm_first=True)
    return nn.TransformerEncoder(layer, layers, nn.LayerNorm(WIDTH), enable_nested_tensor=False)


def decoder(layers, norm):
    layer = nn.TransformerDecoderLayer(WIDTH, HEADS, FEED_FORWARD, 0.0, "relu", 1e-5, True, norm_first=True)
    return nn.TransformerDecoder(layer, layers, norm)


class Network(nn.Module):
    """The stacks: one encoder, or two more that stand for it over muscles and time."""

    def __init__(self, layers, shared, temporal):
        super().__init__()
        norm = nn.LayerNorm(WIDTH)
        self.encoder = encoder(layers)
        if temporal:
            self.muscle_encoder, self.time_encoder = encoder(layers), encoder(layers)
        if shared:
            self.decoder = decoder(layers, norm)
        else:
            self._action_decoder, self._value_decoder = decoder(layers, norm), decoder(layers, norm)


class Policy(nn.Module):
    def __init__(self, words, layers=1, shared=False, temporal=False, predictive=False):
        super().__init__()
        self.log_std = nn.Parameter(torch.zeros(()))
        self.features_extractor = Extractor(words)
        if predictive:
            self.features_extractor.action_tokenizer = nn.Linear(1, WIDTH)
            self.features_extractor.projector = nn.Linear(WIDTH, LAGS)
        self.pi_features_extractor = self.vf_features_extractor = self.features_extractor
        self.mlp_extractor = Network(layers, shared, temporal)
        self.action_net = nn.Sequential(nn.Linear(WIDTH, 1))
        self.log_std_net = nn.Sequential(nn.Linear(WIDTH, 1))
        self.value_net = nn.Sequential(nn.Identity(), nn.Linear(WIDTH, 1))

    def tokens(self, windows, sensors, task):
        table = self.features_extractor.positional_encoder.rows(task)
        words = torch.stack([table[ids].sum(0) for ids in sensors])
        return self.features_extractor.tokenizer(windows) + words

    def queries(self, muscles, task):
        table = self.features_extractor.positional_encoder.rows(task)
        return torch.stack([table[ids].sum(0) for ids in muscles])

    def act(self, queries, memory, scaled):
        stack = self.mlp_extractor.decoder if hasattr(self.mlp_extractor, "decoder") else self.mlp_extractor._action_decoder
        latent = stack(queries[None], memory[None])[0]
        mean = self.action_net(latent)[:, 0]
        sigma = torch.exp(self.log_std).expand(len(mean))
        if scaled:
            spread = torch.exp(torch.softmax(self.log_std_net(latent)[:, 0], 0))
            sigma = sigma * spread / spread.mean()
        return mean, sigma

    def forward(self, windows, sensors, muscles, task, scaled):
        memory = self.mlp_extractor.encoder(self.tokens(windows, sensors, task)[None])[0]
        return self.act(self.queries(muscles, task), memory, scaled)

    def over_time(self, moments, times, sensors, muscles, task, scaled):
        """`moments`: the windows that are looked at, oldest first."""
        spatial = torch.stack([self.mlp_extractor.muscle_encoder(self.tokens(w, sensors, task)[None])[0] for w in moments])
        codes = torch.stack([time_code(t) for t in times])
        sequence = (spatial + codes[:, None]).transpose(0, 1)
        count = len(moments)
        mask = torch.where(torch.ones(count, count).tril().bool(), 0.0, -1e10)
        memory = self.mlp_extractor.time_encoder(sequence, mask=mask)[:, -1]
        return self.act(self.queries(muscles, task) + codes[-1], memory, scaled)


def time_code(time):
    feature = np.arange(WIDTH)
    angle = time * 10000.0 ** (-(feature - feature % 2) / WIDTH)
    return torch.tensor(np.where(feature % 2 == 0, np.sin(angle), np.cos(angle)), dtype=torch.float32)


def randomise(policy, generator):
    """No bias or norm keeps its initial value; padding rows stay zero."""
    with torch.no_grad():
        for name, parameter in policy.named_parameters():
            noise = torch.randn(parameter.shape, generator=generator)
            parameter.add_(noise * (0.05 if "norm" in name or "in_proj_bias" in name else 0.25))
            if "positional_encoder" in name:
                parameter[0].zero_()


# The normaliser's classes live in modules that only the original code has.
def stand_in(module, name):
    sys.modules.setdefault("envs", types.ModuleType("envs"))
    made = sys.modules.setdefault(module, types.ModuleType(module))
    cls = type(name, (), {"__module__": module})
    setattr(made, name, cls)
    return cls


Normaliser = stand_in("envs.multi_env", "FlexibleMultiVecNormalize")
Statistics = stand_in("envs.running_mean_std", "SpecsRunningMeanStd")
ReturnStatistics = stand_in("envs.running_mean_std", "RunningMeanStdFloat32")


def normaliser(signatures, random, tasks, enabled=True):
    """A pickled normaliser over `signatures` and its arrays."""
    count = len(signatures) + 1
    rows = Statistics()
    rows.sig_ids_dict = {(0,): 0}
    for row, ids in enumerate(signatures):
        rows.sig_ids_dict[tuple(np.float32(i) for i in sorted(ids))] = row + 1
    rows.mean_mat = np.vstack([np.zeros((1, LAGS)), random.normal(0, 0.5, (count - 1, LAGS))]).astype(np.float32)
    rows.var_mat = np.vstack([np.ones((1, LAGS)), random.uniform(0.2, 2, (count - 1, LAGS))]).astype(np.float32)
    # Few enough that the prior of weight 1e-4 shows.
    rows.count_mat = np.concatenate([[1e-4], random.uniform(1e-3, 2, count - 1)])
    rows.epsilon, rows.obs_shape = 1e-4, (count - 1, LAGS)
    rows.obs_spec = np.arange(1, count, dtype=np.int32)[None]
    rows.obs_mask = np.ones((1, count - 1), bool)
    whole = Normaliser()
    box = gymnasium.spaces.Box(-np.inf, np.inf, (count - 1, LAGS), np.float32)
    whole.observation_space = gymnasium.spaces.Dict({"obs": box})
    whole.num_envs, whole.training, whole.norm_obs, whole.norm_reward = len(tasks), True, enabled, True
    whole.clip_obs, whole.clip_reward, whole.gamma, whole.epsilon = 10, 10, 0.99, 1e-8
    whole.env_ids_vec, whole.env_id_set = list(tasks), set(tasks)
    whole.env_id_mask_dict = {task: np.array([task == other for other in tasks]) for task in tasks}
    returns = ReturnStatistics()
    returns.mean, returns.var, returns.count = np.float64(0.1), np.float64(2.0), 12.0001
    whole.ret_rms_per_id, whole.ret_rms, whole.old_obs = {task: returns for task in tasks}, RunningMeanStd(shape=()), None
    if enabled:
        whole.obs_rms = rows
    return whole, rows


def loaded(rows, ids):
    """Mean and variance of a token as loading leaves them: merged into fresh statistics of weight 1e-4."""
    row = rows.sig_ids_dict.get(tuple(np.float32(i) for i in sorted(ids)))
    mean, var, count = np.zeros(LAGS), np.ones(LAGS), 1e-4
    if row is not None:
        batch_mean, batch_var, batch_count = (m[row].astype(float) for m in (rows.mean_mat, rows.var_mat, rows.count_mat))
        total, delta = count + batch_count, batch_mean - mean
        var = (var * count + batch_var * batch_count + delta**2 * count * batch_count / total) / total
        mean = mean + delta * batch_count / total
    return mean.astype(np.float32), var.astype(np.float32)


def write(folder, name, policy, *, seed, words=STANDARD, describe=None, statistics_ids=None, tasks=("pen",), scaled=True,
          arguments=None, settings=None, recall=None, enabled=True):
    """Saves `policy` and records what it does in `tasks`. `describe` turns words into rows of the embedding,
    `statistics_ids` into the ids of signatures."""
    folder = folder / name
    folder.mkdir(parents=True, exist_ok=True)
    generator, random = torch.Generator().manual_seed(seed), np.random.default_rng(seed)
    randomise(policy, generator)
    index = {word: i for i, word in enumerate(words)}
    describe = describe or (lambda phrase: [index.get(word, 0) for word in phrase])
    statistics_ids = statistics_ids or describe
    known = [phrase for phrase in SENSORS if 0 not in statistics_ids(phrase)]
    whole, rows = normaliser([statistics_ids(phrase) for phrase in known], random, tasks, enabled)

    layers = len(policy.mlp_extractor.encoder.layers)
    network = {"num_encoder_layers": layers, "num_decoder_layers": layers, "num_heads": HEADS, "layer_norm_eps": 1e-5,
               "dim_feedforward": FEED_FORWARD, "dropout": 0, "norm_first": True,
               "share_decoder": hasattr(policy.mlp_extractor, "decoder")}
    network = {key: value for key, value in {**network, **(settings or {})}.items() if value is not None}
    data = {"policy_kwargs": {"activation_fn": nn.ReLU, "net_arch": network, "log_std_init": -1.0,
                              "policy_outputs_variance": scaled},
            "num_timesteps": 4000, "gamma": 0.99, "learning_rate": 2e-5}
    if settings and settings.get("num_heads", 0) is None:
        del data["policy_kwargs"]["policy_outputs_variance"]
    save_util.save_to_zip_file(folder / "rl_model_4000_steps.zip", data=data, params={"policy": policy.state_dict()},
                               pytorch_variables=None)
    (folder / "rl_model_vecnormalize_4000_steps.pkl").write_bytes(pickle.dumps(whole, protocol=4))
    everything = {"seed": 0, "tasks": [t for t in tasks for _ in range(2)], "num_heads": HEADS, "num_layers": layers,
                  "embedding_size": WIDTH, "dim_feedforward": FEED_FORWARD, "num_memory_steps": LAGS - 1,
                  "policy_outputs_variance": scaled, "separate_vf_decoder": not network.get("share_decoder", True),
                  "load_path": None, "positional_encoding": "learned", **(arguments or {})}
    (folder / "args.json").write_text(json.dumps(everything, indent=1) + "\n")
    if words != STANDARD:
        (folder / "vocabulary.json").write_text(json.dumps({word: i for i, word in enumerate(words)}, indent=1) + "\n")

    episodes = []
    for task in tasks:
        observations = random.normal(0, 1.5, (STEPS, len(SENSORS))).astype(np.float32)
        observations[4, 1] = 60.0  # clipped
        frames = np.vstack([np.zeros((LAGS - 1, len(SENSORS)), np.float32), observations])
        moments = [loaded(rows, statistics_ids(phrase)) for phrase in SENSORS]
        mean, var = (np.stack(part) for part in zip(*moments))
        sensors, muscles = ([describe(phrase) for phrase in phrases] for phrases in (SENSORS, MUSCLES))
        windows, means, sigmas = [], [], []
        for step in range(STEPS):
            window = frames[step:step + LAGS].T
            if enabled:
                window = np.clip((window - mean) / np.sqrt(var + np.float32(1e-8)), -10, 10)
            windows.append(torch.tensor(np.ascontiguousarray(window)))
            with torch.no_grad():
                if recall is None:
                    action, sigma = policy(windows[-1], sensors, muscles, task, scaled)
                else:
                    kept, interval = recall
                    times = [t for t in range(step, -1, -interval)][:kept][::-1]
                    action, sigma = policy.over_time([windows[t] for t in times], times, sensors, muscles, task, scaled)
            means.append(action.tolist())
            sigmas.append(sigma.tolist())
        episodes.append({"task": task, "observations": observations.tolist(), "means": means, "deviations": sigmas})
    recorded = {"sensors": SENSORS, "muscles": MUSCLES, "episodes": episodes}
    (folder / "recorded.json").write_text(json.dumps(recorded) + "\n")


def main(folder):
    # Nothing about the machine that made them.
    save_util.get_system_info = lambda print_info: ({}, "")
    count = len(STANDARD)
    torch.manual_seed(0)
    write(folder, "separate", Policy(LearnedWords(count), layers=2), seed=1, scaled=False)
    write(folder, "shared_waves_predictive", Policy(WaveWords(count), shared=True, predictive=True), seed=2,
          settings={"num_heads": None}, arguments={"positional_encoding": "sine"})
    tasks = ("pen", "baoding_p1_cw")
    write(folder, "task_words", Policy(TaskWords(count, tasks)), seed=3, tasks=tasks,
          arguments={"positional_encoding": "task_specific", "task_specific_learnable": True})

    keys = sorted({"/".join(phrase) for phrase in SENSORS + MUSCLES})
    atomic = ["padding", "value", *keys]
    standard = {word: i for i, word in enumerate(STANDARD)}
    write(folder, "atomic", Policy(LearnedWords(len(atomic))), seed=4, words=atomic,
          describe=lambda phrase: [atomic.index("/".join(phrase))],
          statistics_ids=lambda phrase: [standard[word] for word in phrase], arguments={"vocabulary_mode": "atomic"})

    # A run from before some words existed, in another order.
    old = ["padding", "value"] + sorted(set(STANDARD[2:]) - {"soleus", "id_2", "contact"})
    write(folder, "older_vocabulary", Policy(LearnedWords(len(old))), seed=5, words=old, arguments={"tasks": ["elbow_pose"]})
    write(folder, "temporal", Policy(LearnedWords(count), shared=True, temporal=True), seed=6, recall=(3, 2),
          arguments={"k_bilateral": 3, "time_skip": 2, "mask_rate": 1.0})
    write(folder, "not_normalising", Policy(LearnedWords(count)), seed=7, enabled=False, arguments={"ablate_obs_norm": True})


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
