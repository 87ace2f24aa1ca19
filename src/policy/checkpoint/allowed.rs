//! Which globals a pickle may name, per kind of file (`spec/policy.md` §3.8). Whatever is not listed here rejects the
//! whole file. A listed global is only a name: nothing is imported, nothing is called.

use super::records::printable;

/// What a pickle is expected to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// `data.pkl` inside a torch file.
    TorchArchive,
    /// `data.pkl` of a torch file that may hold a policy's construction beside its weights.
    TorchPolicy,
    /// One of the consecutive pickles of torch's old stream format.
    TorchStream,
    /// Normaliser of the Arnold transformer.
    SignatureNormaliser,
    /// Stable-Baselines3 `VecNormalize`.
    ComponentNormaliser,
    /// scikit-learn's `StandardScaler`.
    Scaler,
    /// `mjrl` natural-policy-gradient policy.
    NaturalGradient,
    /// A pickle whose globals are only listed, never interpreted.
    Listing,
    /// No global at all: used to learn the first one that is named.
    Nothing,
}

impl Kind {
    /// The canonical dotted name of a global, if a pickle of this kind may name it.
    pub(super) fn admit(self, module: &str, name: &str) -> Option<String> {
        let lists: &[&[(&str, &str)]] = match self {
            Self::Listing => return Some(printable(&format!("{module}.{name}"))),
            Self::Nothing => &[],
            Self::TorchArchive => &[STORAGES, TENSORS],
            Self::TorchPolicy => &[STORAGES, TENSORS, NUMPY, CONSTRUCTION],
            Self::TorchStream => &[STORAGES],
            Self::Scaler => &[NUMPY, SCALER],
            Self::SignatureNormaliser => &[NUMPY, SIGNATURE_NORMALISER],
            Self::ComponentNormaliser => &[NUMPY, COMPONENT_NORMALISER],
            Self::NaturalGradient => &[NUMPY, TENSORS, NATURAL_GRADIENT],
        };
        // NumPy 2 moved its private modules, Python 3 renamed the built-in one; files of all ages name the same things.
        let module = match (module.strip_prefix("numpy._core."), module) {
            (Some(rest), _) => format!("numpy.core.{rest}"),
            (None, "__builtin__") => "builtins".to_owned(),
            (None, _) => module.to_owned(),
        };
        let known = lists.iter().any(|list| list.contains(&(module.as_str(), name)));
        known.then(|| format!("{module}.{name}"))
    }

    /// Whether persistent ids, torch's references to storages, may occur.
    pub(super) fn has_storages(self) -> bool {
        matches!(self, Self::TorchArchive | Self::TorchPolicy | Self::TorchStream | Self::Listing)
    }
}

const STORAGES: &[(&str, &str)] = &[
    ("torch", "FloatStorage"),
    ("torch", "DoubleStorage"),
    ("torch", "HalfStorage"),
    ("torch", "BFloat16Storage"),
    ("torch", "LongStorage"),
    ("torch", "IntStorage"),
    ("torch", "ByteStorage"),
    ("torch", "BoolStorage"),
];

const TENSORS: &[(&str, &str)] = &[
    ("collections", "OrderedDict"),
    ("torch._utils", "_rebuild_tensor_v2"),
    ("torch._utils", "_rebuild_parameter"),
];

const NUMPY: &[(&str, &str)] = &[
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
];

const SIGNATURE_NORMALISER: &[(&str, &str)] = &[
    ("envs.multi_env", "FlexibleMultiVecNormalize"),
    ("envs.running_mean_std", "SpecsRunningMeanStd"),
    ("envs.running_mean_std", "RunningMeanStdFloat32"),
    ("stable_baselines3.common.running_mean_std", "RunningMeanStd"),
    ("collections", "OrderedDict"),
    ("gymnasium.spaces.dict", "Dict"),
    ("gymnasium.spaces.box", "Box"),
    ("numpy.random._pickle", "__generator_ctor"),
    ("numpy.random._pickle", "__bit_generator_ctor"),
];

const COMPONENT_NORMALISER: &[(&str, &str)] = &[
    ("stable_baselines3.common.vec_env.vec_normalize", "VecNormalize"),
    ("envs.multi_env", "MyVecNormalize"),
    ("stable_baselines3.common.running_mean_std", "RunningMeanStd"),
    ("gym.spaces.box", "Box"),
    ("gymnasium.spaces.box", "Box"),
    ("numpy.random._pickle", "__randomstate_ctor"),
    ("numpy.random._pickle", "__generator_ctor"),
    ("numpy.random._pickle", "__bit_generator_ctor"),
];

/// What `policy.save` of Stable-Baselines3 writes beside the weights: spaces, classes, a bound method that `pickle.rs`
/// accepts with one pair of arguments. Only the activation function's name is looked at.
const CONSTRUCTION: &[(&str, &str)] = &[
    ("gym.spaces.box", "Box"),
    ("gymnasium.spaces.box", "Box"),
    ("gymnasium.spaces.dict", "Dict"),
    ("stable_baselines3.common.policies", "BasePolicy"),
    ("stable_baselines3.common.torch_layers", "FlattenExtractor"),
    ("stable_baselines3.common.torch_layers", "CombinedExtractor"),
    ("torch.nn.modules.activation", "ReLU"),
    ("torch.nn.modules.activation", "Tanh"),
    ("torch.nn.modules.activation", "ELU"),
    ("torch.nn.modules.activation", "SiLU"),
    ("torch.nn.modules.activation", "GELU"),
    ("torch.optim.adam", "Adam"),
    ("_codecs", "encode"),
    ("builtins", "getattr"),
];

const SCALER: &[(&str, &str)] = &[("sklearn.preprocessing._data", "StandardScaler")];

/// `builtins.getattr` and `builtins.set` are admitted as names only; `pickle.rs` accepts `getattr` for `tanh` of torch's
/// table of functions (whose class newer versions name) and `set` of an empty list (the buffers that a module of a newer
/// torch does not store: none).
const NATURAL_GRADIENT: &[(&str, &str)] = &[
    ("mjrl.policies.gaussian_mlp", "MLP"),
    ("mjrl.utils.fc_network", "FCNetwork"),
    ("torch.nn.modules.container", "ModuleList"),
    ("torch.nn.modules.linear", "Linear"),
    ("torch.storage", "_load_from_bytes"),
    ("torch._C", "_VariableFunctions"),
    ("torch._C", "_VariableFunctionsClass"),
    ("builtins", "getattr"),
    ("builtins", "set"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_admitted_only_with_its_own_module() {
        let kind = Kind::TorchArchive;
        assert_eq!(kind.admit("torch", "FloatStorage").as_deref(), Some("torch.FloatStorage"));
        // The same dotted name, cut elsewhere, would make Python walk attributes.
        assert_eq!(kind.admit("torch", "_utils._rebuild_tensor_v2"), None);
        assert_eq!(kind.admit("os", "system"), None);
        assert_eq!(kind.admit("torch.storage", "_load_from_bytes"), None);
    }

    #[test]
    fn both_ages_of_numpy_name_the_same_thing() {
        let name = Kind::ComponentNormaliser.admit("numpy._core.multiarray", "scalar");
        assert_eq!(name.as_deref(), Some("numpy.core.multiarray.scalar"));
    }
}
