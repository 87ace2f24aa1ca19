"""Pieces of files: pickle programs, NumPy arrays, torch tensors, normalisers, policies.

A pickle is a program for a stack machine. Each function of the first part returns the piece of program that leaves one
value on the stack, so that pieces nest like the values they build. Nothing here needs more than the standard library.
"""

import struct
from math import prod

from archive import archive

# ---- pickle programs -------------------------------------------------------------------------------------------------


def pickle(value, protocol=4):
    return bytes([0x80, protocol]) + value + b"."


NONE = b"N"


def boolean(value):
    return b"\x88" if value else b"\x89"


def integer(value):
    """Four bytes if they suffice, else LONG1 with eight."""
    if -(2**31) <= value < 2**31:
        return b"J" + struct.pack("<i", value)
    return b"\x8a\x08" + struct.pack("<q", value)


def number(value):
    return b"G" + struct.pack(">d", value)


def text(value):
    encoded = value.encode()
    return b"X" + struct.pack("<I", len(encoded)) + encoded


def byte_string(value):
    return b"B" + struct.pack("<I", len(value)) + value


def name(dotted):
    """A global; the last dot separates it from its module."""
    module, _, attribute = dotted.rpartition(".")
    return f"c{module}\n{attribute}\n".encode()


def sequence(*items):
    return b"(" + b"".join(items) + b"t"


def items(*values):
    return b"](" + b"".join(values) + b"e"


def mapping(*pairs):
    return b"}(" + b"".join(key + value for key, value in pairs) + b"u"


def named(**values):
    return mapping(*((text(key), value) for key, value in values.items()))


def call(dotted, *arguments):
    return name(dotted) + sequence(*arguments) + b"R"


def instance(dotted, **attributes):
    return name(dotted) + b")\x81" + named(**attributes) + b"b"


# ---- NumPy -----------------------------------------------------------------------------------------------------------


def dtype(code, order="<"):
    state = sequence(integer(3), text(order), NONE, NONE, NONE, integer(-1), integer(-1), integer(0))
    return call("numpy.dtype", text(code), boolean(False), boolean(True)) + state + b"b"


def raw_array(shape, element, content, column_major=boolean(False)):
    """An array with any claims."""
    empty = call("numpy.core.multiarray._reconstruct", name("numpy.ndarray"), sequence(integer(0)), byte_string(b"b"))
    return empty + sequence(integer(1), sequence(*shape), element, column_major, content) + b"b"


def array(shape, values):
    content = byte_string(struct.pack(f"<{len(values)}d", *values))
    return raw_array([integer(axis) for axis in shape], dtype("f8"), content)


# ---- normalisers -----------------------------------------------------------------------------------------------------

VECNORMALIZE = "stable_baselines3.common.vec_env.vec_normalize.VecNormalize"
MOMENTS = "stable_baselines3.common.running_mean_std.RunningMeanStd"


def component_normaliser(mean=None, variance=None, epsilon=1e-8, clip=10.0, smuggled=None):
    """Stable-Baselines3's; `smuggled` becomes an attribute that nobody reads."""
    attributes = {
        "obs_rms": instance(
            MOMENTS,
            mean=mean or array([3], [0.0, 1.0, -2.0]),
            var=variance or array([3], [1.0, 0.5, 4.0]),
            count=number(100.0),
        ),
        "epsilon": number(epsilon),
        "clip_obs": number(clip),
        "norm_obs": boolean(True),
    }
    if smuggled is not None:
        attributes["old_reward"] = smuggled
    return pickle(instance(VECNORMALIZE, **attributes))


def signature_normaliser(*signatures, variance=1.0):
    """Arnold's, with rows of three lags for the given signatures: pairs of words and row."""
    pairs = [(sequence(*words), integer(row)) for words, row in signatures]
    moments = instance(
        "envs.running_mean_std.SpecsRunningMeanStd",
        sig_ids_dict=mapping(*pairs),
        mean_mat=array([2, 3], [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]),
        var_mat=array([2, 3], [1.0] * 5 + [variance]),
        count_mat=array([2], [1e-4, 100.0]),
    )
    return pickle(
        instance(
            "envs.multi_env.FlexibleMultiVecNormalize", obs_rms=moments, epsilon=number(1e-8), clip_obs=integer(10)
        )
    )


PADDING = ([integer(0)], 0)
GOOD_SIGNATURES = [PADDING, ([integer(5), integer(130)], 1)]

# ---- torch -----------------------------------------------------------------------------------------------------------


def storage(kind, key, count, *more):
    """The persistent id of a storage."""
    return sequence(text("storage"), name(kind), text(key), text("cpu"), integer(count), *more) + b"Q"


def tensor(of, offset, shape, strides):
    """A tensor with any claims."""
    sizes = [sequence(*map(integer, axes)) for axes in (shape, strides)]
    hooks = call("collections.OrderedDict")
    return call("torch._utils._rebuild_tensor_v2", of, integer(offset), *sizes, boolean(False), hooks)


def vector(key, count):
    """A tensor that is the whole of its storage."""
    return tensor(storage("torch.FloatStorage", key, count), 0, [count], [1])


def floats(*values):
    return struct.pack(f"<{len(values)}f", *values)


ONES = floats(1, 1, 1)


def torch_file(program, storages, order=b"little"):
    members = {"archive/data.pkl": program, "archive/byteorder": order}
    members |= {f"archive/data/{key}": content for key, content in storages.items()}
    return archive(members)


def state(**tensors):
    """The pickle of a state dictionary; `__` stands for a dot."""
    return pickle(mapping(*((text(key.replace("__", ".")), value) for key, value in tensors.items())))


SETTINGS = b'{"num_timesteps": 7, "policy_kwargs": {}}'
GOOD_WEIGHTS = torch_file(state(action_net__weight=vector("0", 3)), {"0": ONES})


def policy(weights=GOOD_WEIGHTS, settings=SETTINGS, **more):
    """A Stable-Baselines3 archive around a torch file."""
    return archive({"data": settings, "policy.pth": weights, "_stable_baselines3_version": b"2.2.1", **more})


def policy_with(weight):
    """A policy whose one weight is as described, with a storage of three ones."""
    return policy(torch_file(state(action_net__weight=weight), {"0": ONES}))


# ---- NPG policies, with torch's old streams inside -------------------------------------------------------------------


def stream(count, content, little_endian=True, magic=bytes.fromhex("6cfc9c46f9206aa85019"), claimed=None):
    """A storage in torch's old format: five pickles, the number of elements, the elements."""
    reference = storage("torch.FloatStorage", "k", count, NONE)
    parts = [
        b"\x8a" + bytes([len(magic)]) + magic,
        integer(1001),
        named(little_endian=boolean(little_endian)),
        reference,
        items(text("k")),
    ]
    return b"".join(map(pickle, parts)) + struct.pack("<q", count if claimed is None else claimed) + content


def embedded(shape, of=None):
    """A tensor of ones whose storage is embedded in the pickle, or given as a stream."""
    of = of if of is not None else stream(prod(shape), floats(*[1] * prod(shape)))
    strides = [prod(shape[axis + 1 :]) for axis in range(len(shape))]
    return tensor(call("torch.storage._load_from_bytes", byte_string(of)), 0, shape, strides)


TANH = call("builtins.getattr", name("torch._C._VariableFunctions"), text("tanh"))


def gradient_policy(in_shift=None, nonlinearity=TANH, smuggled=NONE):
    """An `mjrl` policy of one layer, from two observations to three muscles."""
    parameters = named(weight=embedded([3, 2]), bias=embedded([3]))
    layer = instance("torch.nn.modules.linear.Linear", _parameters=parameters)
    layers = instance("torch.nn.modules.container.ModuleList", _modules=mapping((text("0"), layer)))
    network = instance(
        "mjrl.utils.fc_network.FCNetwork",
        _modules=named(fc_layers=layers),
        in_shift=in_shift or embedded([2]),
        in_scale=embedded([2]),
        out_shift=embedded([3]),
        out_scale=embedded([3]),
        nonlinearity=nonlinearity,
        extra=smuggled,
    )
    return pickle(instance("mjrl.policies.gaussian_mlp.MLP", model=network, log_std=embedded([3])))
