"""Pickles that run something when Python reads them. Each really leaves the marker: `make_corpus.py check` proves it."""

import base64
import marshal
import pickle as python_pickle
import struct

from cases import COMMAND, MARKER, cases
from pieces import *  # noqa: F403

SYSTEM = call("os.system", text(COMMAND))
BASE_POLICY = "stable_baselines3.common.policies.BasePolicy"
PYTHON = f"open({MARKER!r}, 'w').close()"


def short(value):
    encoded = value.encode()
    return b"\x8c" + bytes([len(encoded)]) + encoded


def stack_name(module, attribute):
    """A global whose two parts are texts on the stack."""
    return short(module) + short(attribute) + b"\x93"


def import_of(module):
    return call("importlib.import_module", text(module))


def code_object():
    """A function made of marshalled byte code, as cloudpickle makes its functions. Differs between Python versions."""
    return marshal.dumps(compile(PYTHON, "x", "exec"))


# What Python calls, by the name that gives it away first.
CALLS = {
    "os.system": SYSTEM,
    "posix.system": call("posix.system", text(COMMAND)),
    "subprocess.call": call("subprocess.call", items(text("touch"), text(MARKER))),
    "subprocess.check_output": call("subprocess.check_output", items(text("touch"), text(MARKER))),
    "subprocess.getoutput": call("subprocess.getoutput", text(COMMAND)),
    "os.mkdir": call("os.mkdir", text(MARKER)),
    "builtins.eval": call("builtins.eval", text(f"open({MARKER!r}, 'w').close()")),
    "builtins.exec": call("builtins.exec", text(PYTHON)),
    "builtins.open": call("builtins.open", text(MARKER), text("w")),
    "builtins.__import__": call("builtins.getattr", call("builtins.__import__", text("os")), text("system"))
    + sequence(text(COMMAND))
    + b"R",
    "importlib.import_module": call("operator.methodcaller", text("system"), text(COMMAND))
    + sequence(import_of("os"))
    + b"R",
    "operator.attrgetter": call("operator.attrgetter", text("system")) + sequence(import_of("os")) + b"R"
    + sequence(text(COMMAND)) + b"R",
    "functools.partial": call("functools.partial", call("operator.attrgetter", text("system")) + sequence(import_of("os"))
        + b"R", text(COMMAND)) + b")R",
    "timeit.timeit": call("timeit.timeit", text("pass"), text(PYTHON)),
    "code.InteractiveInterpreter": call(
        "operator.methodcaller", text("runsource"), text(PYTHON)
    ) + sequence(call("code.InteractiveInterpreter")) + b"R",
    "cProfile.run": call("cProfile.run", text(PYTHON), text("/dev/null")),
    "runpy._run_code": call("runpy._run_code", text(PYTHON), mapping()),
    "pathlib.Path.touch": stack_name("pathlib", "Path.touch") + sequence(call("pathlib.Path", text(MARKER))) + b"R",
    "shutil.copyfile": call("shutil.copyfile", text("/dev/null"), text(MARKER)),
    "logging.FileHandler": call("logging.FileHandler", text(MARKER)),
    "pickle.loads": call("pickle.loads", byte_string(pickle(SYSTEM))),
    "_pickle.loads": call("_pickle.loads", byte_string(pickle(SYSTEM))),
    "types.FunctionType": call(
        "types.FunctionType", call("marshal.loads", byte_string(code_object())), mapping()
    ) + b")R",
}  # fmt: skip

# The same call, written so that a list of forbidden names or of suspicious opcodes would miss it.
DISGUISES = [
    ("STACK_GLOBAL", stack_name("os", "system") + sequence(text(COMMAND)) + b"R", "UnknownGlobal", "os.system"),
    (
        "a dotted name that walks through another module",
        stack_name("logging", "os.system") + sequence(text(COMMAND)) + b"R",
        "UnknownGlobal",
        "logging.os.system",
    ),
    ("INST", b"(" + text(COMMAND) + b"ios\nsystem\n", "ForbiddenOpcode", "0x69"),
    ("OBJ", b"(" + name("os.system") + text(COMMAND) + b"o", "UnknownGlobal", "os.system"),
    (
        "NEWOBJ of a tuple, whose elements are calls that wait",
        name("builtins.tuple")
        + sequence(name("builtins.map") + sequence(name("os.system"), items(text(COMMAND))) + b"\x81")
        + b"\x81",
        "UnknownGlobal",
        "builtins.tuple",
    ),
    (
        "an extension code, registered on the way",
        call("copyreg.add_extension", text("os"), text("system"), integer(240)) + b"0\x82\xf0" + sequence(text(COMMAND))
        + b"R",
        "UnknownGlobal",
        "copyreg.add_extension",
    ),
    (
        "a state that is a method, then one that calls it",
        name("types.SimpleNamespace") + b")R" + named(__setstate__=name("os.system")) + b"b" + text(COMMAND) + b"b",
        "UnknownGlobal",
        "types.SimpleNamespace",
    ),
    (
        "protocol 0 text opcodes",
        b"cos\nsystem\n(S'" + COMMAND.encode() + b"'\ntR",
        "UnknownGlobal",
        "os.system",
    ),
    (
        "a name kept in the memo, dropped and recalled",
        text("os") + b"\x94" + text("system") + b"\x9400h\x00h\x01\x93" + sequence(text(COMMAND)) + b"R",
        "UnknownGlobal",
        "os.system",
    ),
]  # fmt: skip


def live():
    alone = [(f"{dotted}, alone", pickle(code), "Pickle/UnknownGlobal") for dotted, code in CALLS.items()]
    smuggled = [
        (f"{dotted} among the attributes", component_normaliser(smuggled=CALLS[dotted]), "Pickle/UnknownGlobal", dotted)
        for dotted in ("os.system", "builtins.eval", "subprocess.call", "pickle.loads")
    ]
    disguised = [
        (f"os.system by {how}", component_normaliser(smuggled=code), f"Pickle/{error}", says)
        for how, code, error, says in DISGUISES
    ]
    in_policies = [
        ("os.system instead of a policy", pickle(SYSTEM), "Pickle/UnknownGlobal", "os.system"),
        ("os.system instead of a weight", policy_with(SYSTEM), "Pickle/UnknownGlobal", "policy.pth", "os.system"),
        ("os.system as the state dictionary", policy(torch_file(pickle(SYSTEM), {})), "Pickle/UnknownGlobal", "os.system"),
        (
            "os.system as the size of a tensor",
            policy_with(tensor(SYSTEM, 0, [3], [1])),
            "Pickle/UnknownGlobal",
            "os.system",
        ),
        (
            "os.system beside the weights",
            torch_file(pickle(named(state_dict=mapping(), data=SYSTEM)), {}),
            "Pickle/UnknownGlobal",
            "os.system",
        ),
        ("builtins.eval in a bare torch file", torch_file(pickle(CALLS["builtins.eval"]), {}), "Pickle/UnknownGlobal"),
        ("os.system in an NPG policy", gradient_policy(smuggled=SYSTEM), "Pickle/UnknownGlobal", "os.system"),
    ]
    stream_program = [
        (
            "os.system in an embedded stream",
            gradient_policy(in_shift=embedded([2], pickle(SYSTEM))),
            "EmbeddedTensor/UnknownGlobal",
            "in_shift",
            "os.system",
        ),
    ]
    blob = base64.b64encode(pickle(SYSTEM)).decode()
    settings = f'{{"num_timesteps": 7, "lr_schedule": {{":type:": "function", ":serialized:": "{blob}"}}}}'
    optimiser = torch_file(pickle(SYSTEM), {})
    unread = [
        ("os.system in the settings' serialised text, which is never decoded", policy(settings=settings.encode()), None),
        ("os.system in the optimiser, which is never read", policy(**{"policy.optimizer.pth": optimiser}), None),
    ]
    return (
        cases("normaliser", alone + smuggled + disguised, live=True)
        + cases("policy", in_policies + stream_program + unread, live=True)
    )


def forbidden():
    """What no checkpoint needs, whether Python would run something or fail."""
    numpy_array = name("numpy.ndarray")
    rows = [
        ("a global hidden in a text of two parts", stack_name("numpy", "core.multiarray.scalar"), "UnknownGlobal",
            "numpy.core.multiarray.scalar"),
        ("a global whose module is computed", call("numpy.dtype") + text("x") + b"\x93", "WrongOperand", "STACK_GLOBAL"),
        ("a global whose name is a number", text("numpy") + integer(3) + b"\x93", "WrongOperand", "STACK_GLOBAL"),
        ("a global in another alphabet", stack_name("numpy", "d\u0442ype"), "UnknownGlobal"),
        ("a global with a line break in its name", stack_name("numpy", "dtype\nx"), "UnknownGlobal", "\\n"),
        ("a global of full-width letters", stack_name("\uff4eumpy", "dtype"), "UnknownGlobal"),
        ("a name that would rewrite the terminal", b"c\x1b[2J\nx\n", "UnknownGlobal"),
        ("a name with a zero in it", b"cnumpy\0os\nsystem\n", "UnknownGlobal"),
        ("calling the result of a call", call("numpy.dtype") + b")R", "WrongOperand", "REDUCE"),
        ("calling a text", text("os.system") + b")R", "WrongOperand", "REDUCE"),
        ("calling with a list instead of a tuple", name("numpy.dtype") + b"]R", "WrongOperand", "REDUCE"),
        ("a state on a name", numpy_array + named() + b"b", "WrongOperand", "BUILD"),
        ("a state on a dictionary", mapping() + named(__class__=NONE) + b"b", "WrongOperand", "BUILD"),
        ("two states on one record", call("numpy.dtype") + named(__dict__=NONE) + b"b" + named(__dict__=NONE) + b"b",
            "WrongOperand", "BUILD"),
        ("INST", b"(inumpy\ndtype\n", "ForbiddenOpcode", "0x69"),
        ("OBJ", b"(" + numpy_array + b"o", "ForbiddenOpcode", "0x6f"),
        ("NEWOBJ_EX", numpy_array + b")}\x92", "ForbiddenOpcode", "0x92"),
        ("EXT1", b"\x82\x01", "ForbiddenOpcode", "0x82"),
        ("EXT2", b"\x83\x01\x00", "ForbiddenOpcode", "0x83"),
        ("EXT4", b"\x84\x01\x00\x00\x00", "ForbiddenOpcode", "0x84"),
        ("PERSID", b"Pstorage\n", "ForbiddenOpcode", "0x50"),
        ("a persistent id where none belongs", text("x") + b"Q", "ForbiddenOpcode", "0x51"),
        ("NEXT_BUFFER", b"\x97", "ForbiddenOpcode", "0x97"),
        ("READONLY_BUFFER", b"N\x98", "ForbiddenOpcode", "0x98"),
        ("an opcode that does not exist", b"\xfe", "ForbiddenOpcode", "0xfe"),
    ]  # fmt: skip
    found = cases(
        "normaliser",
        [(what, component_normaliser(smuggled=code), f"Pickle/{error}", *says) for what, code, error, *says in rows],
    )
    load = call("torch.storage._load_from_bytes", byte_string(b""))
    getattr_of = lambda *arguments: gradient_policy(nonlinearity=call("builtins.getattr", *arguments))  # noqa: E731
    functions = name("torch._C._VariableFunctions")
    set_of = lambda argument: gradient_policy(nonlinearity=call("builtins.set", argument))  # noqa: E731
    return found + cases(
        "policy",
        [
            ("a pickle within the pickle", policy_with(load), "Pickle/UnknownGlobal", "torch.storage._load_from_bytes"),
            ("getattr of another function", getattr_of(functions, text("save")), "Pickle/ForbiddenCall", "getattr"),
            ("getattr of another owner", getattr_of(name("numpy.ndarray"), text("tanh")), "Pickle/ForbiddenCall"),
            ("getattr with a default", getattr_of(functions, text("tanh"), NONE), "Pickle/ForbiddenCall"),
            (
                "getattr of two names that are each allowed elsewhere",
                torch_file(pickle(call("builtins.getattr", name(BASE_POLICY), text("save"))), {}),
                "Pickle/ForbiddenCall",
                "builtins.getattr",
            ),
            (
                "what `policy.save` names, in the weights of an archive",
                policy_with(call("builtins.getattr", name(BASE_POLICY), text("_dummy_schedule"))),
                "Pickle/UnknownGlobal",
                "builtins.getattr",
            ),
            ("a set of something", set_of(items(integer(1))), "Pickle/ForbiddenCall", "builtins.set"),
            ("a set of a name", set_of(name("builtins.getattr")), "Pickle/ForbiddenCall", "builtins.set"),
            (
                "a text in another encoding",
                torch_file(pickle(call("_codecs.encode", text("x"), text("rot13"))), {}),
                "Pickle/ForbiddenCall",
                "_codecs.encode",
            ),
            ("an object of scikit-learn", pickle(instance("sklearn.decomposition._pca.PCA")), "NotAPolicy", "PCA"),
            ("a normaliser instead of a policy", component_normaliser(), "NotAPolicy"),
            (
                "a class of Python's own, pickled by Python",
                python_pickle.dumps(struct.Struct, protocol=4),
                "Pickle/UnknownGlobal",
                "_struct.Struct",
            ),
        ],
    )
