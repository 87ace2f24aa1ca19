//! Files built byte by byte: small good checkpoints, from which the hostile ones differ in one thing.
//!
//! A pickle is a program. Each function here returns the piece of program that leaves one value on the stack, so that
//! pieces nest like the values they build.

use std::io::{Cursor, Write};

use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

/// A piece of pickle program that leaves one value.
pub(crate) type Code = Vec<u8>;

/// A whole pickle.
pub(crate) fn pickle(value: &[u8]) -> Code {
    [b"\x80\x04", value, b"."].concat()
}

pub(crate) fn none() -> Code {
    b"N".to_vec()
}

pub(crate) fn boolean(value: bool) -> Code {
    vec![if value { 0x88 } else { 0x89 }]
}

pub(crate) fn int(value: i32) -> Code {
    [b"J".as_slice(), &value.to_le_bytes()].concat()
}

/// An integer of eight bytes.
pub(crate) fn long(value: i64) -> Code {
    [b"\x8a\x08".as_slice(), &value.to_le_bytes()].concat()
}

pub(crate) fn float(value: f64) -> Code {
    [b"G".as_slice(), &value.to_be_bytes()].concat()
}

pub(crate) fn text(value: &str) -> Code {
    [b"X".as_slice(), &u32::try_from(value.len()).unwrap().to_le_bytes(), value.as_bytes()].concat()
}

pub(crate) fn bytes(value: &[u8]) -> Code {
    [b"B".as_slice(), &u32::try_from(value.len()).unwrap().to_le_bytes(), value].concat()
}

pub(crate) fn global(name: &str) -> Code {
    let (module, name) = name.rsplit_once('.').unwrap();
    format!("c{module}\n{name}\n").into_bytes()
}

pub(crate) fn tuple(items: &[Code]) -> Code {
    [b"(".as_slice(), &items.concat(), b"t"].concat()
}

pub(crate) fn list(items: &[Code]) -> Code {
    [b"](".as_slice(), &items.concat(), b"e"].concat()
}

pub(crate) fn dictionary(pairs: &[(Code, Code)]) -> Code {
    let pairs: Vec<u8> = pairs.iter().flat_map(|(key, value)| [&key[..], value].concat()).collect();
    [b"}(".as_slice(), &pairs, b"u"].concat()
}

/// A dictionary with texts as keys.
pub(crate) fn named(pairs: &[(&str, Code)]) -> Code {
    let pairs: Vec<_> = pairs.iter().map(|(key, value)| (text(key), value.clone())).collect();
    dictionary(&pairs)
}

/// `name(*arguments)`.
pub(crate) fn call(name: &str, arguments: &[Code]) -> Code {
    [global(name), tuple(arguments), b"R".to_vec()].concat()
}

/// An instance of `class` with attributes.
pub(crate) fn object(class: &str, attributes: &[(&str, Code)]) -> Code {
    [&global(class)[..], b")\x81", &named(attributes), b"b"].concat()
}

pub(crate) fn dtype(code: &str, order: &str) -> Code {
    let made = call("numpy.dtype", &[text(code), boolean(false), boolean(true)]);
    let state = [int(3), text(order), none(), none(), none(), int(-1), int(-1), int(0)];
    [&made[..], &tuple(&state), b"b"].concat()
}

/// A NumPy array with any claims.
pub(crate) fn raw_array(shape: &[Code], element: Code, content: Code) -> Code {
    let empty = [global("numpy.ndarray"), tuple(&[int(0)]), bytes(b"b")];
    let made = call("numpy.core.multiarray._reconstruct", &empty);
    let state = tuple(&[int(1), tuple(shape), element, boolean(false), content]);
    [&made[..], &state, b"b"].concat()
}

/// A NumPy array of `f8`.
pub(crate) fn array(shape: &[i32], values: &[f64]) -> Code {
    let shape: Vec<Code> = shape.iter().map(|&axis| int(axis)).collect();
    let content: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    raw_array(&shape, dtype("f8", "<"), bytes(&content))
}

pub(crate) const VECNORMALIZE: &str = "stable_baselines3.common.vec_env.vec_normalize.VecNormalize";
const MOMENTS: &str = "stable_baselines3.common.running_mean_std.RunningMeanStd";

/// A `VecNormalize` with the given mean and variance.
pub(crate) fn component_normaliser(mean: Code, variance: Code) -> Code {
    let moments = object(MOMENTS, &[("mean", mean), ("var", variance), ("count", float(100.0))]);
    let attributes = [
        ("obs_rms", moments),
        ("epsilon", float(1e-8)),
        ("clip_obs", float(10.0)),
        ("norm_obs", boolean(true)),
    ];
    pickle(&object(VECNORMALIZE, &attributes))
}

pub(crate) fn good_component_normaliser() -> Code {
    component_normaliser(array(&[3], &[0.0, 1.0, -2.0]), array(&[3], &[1.0, 0.5, 4.0]))
}

/// An Arnold normaliser with the given table of signatures and two rows of statistics for three lags.
pub(crate) fn signature_normaliser(table: Code) -> Code {
    let moments = [
        ("sig_ids_dict", table),
        ("mean_mat", array(&[2, 3], &[0.0, 0.0, 0.0, 1.0, 2.0, 3.0])),
        ("var_mat", array(&[2, 3], &[1.0; 6])),
        ("count_mat", array(&[2], &[1e-4, 100.0])),
    ];
    let attributes = [
        ("obs_rms", object("envs.running_mean_std.SpecsRunningMeanStd", &moments)),
        ("epsilon", float(1e-8)),
        ("clip_obs", int(10)),
    ];
    pickle(&object("envs.multi_env.FlexibleMultiVecNormalize", &attributes))
}

pub(crate) fn good_signature_normaliser() -> Code {
    let row =
        |words: &[i32], row| (tuple(&words.iter().map(|&w| int(w)).collect::<Vec<_>>()), int(row));
    signature_normaliser(dictionary(&[row(&[0], 0), row(&[5, 130], 1)]))
}

/// The persistent id of a torch storage.
pub(crate) fn storage(class: &str, key: &str, count: Code) -> Code {
    let reference = tuple(&[text("storage"), global(class), text(key), text("cpu"), count]);
    [&reference[..], b"Q"].concat()
}

/// A torch tensor with any claims.
pub(crate) fn tensor(storage: Code, offset: i32, shape: &[i64], strides: &[i64]) -> Code {
    let sizes = |sizes: &[i64]| tuple(&sizes.iter().map(|&size| long(size)).collect::<Vec<_>>());
    let hooks = call("collections.OrderedDict", &[]);
    let arguments = [storage, int(offset), sizes(shape), sizes(strides), boolean(false), hooks];
    call("torch._utils._rebuild_tensor_v2", &arguments)
}

/// A tensor of `count` elements in its own storage.
pub(crate) fn vector(key: &str, count: i32) -> Code {
    tensor(storage("torch.FloatStorage", key, int(count)), 0, &[i64::from(count)], &[1])
}

/// A zip archive of stored members.
pub(crate) fn archive(members: &[(&str, &[u8])]) -> Vec<u8> {
    archive_with(CompressionMethod::Stored, members)
}

pub(crate) fn archive_with(method: CompressionMethod, members: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(method);
    for (name, content) in members {
        writer.start_file(*name, options).unwrap();
        writer.write_all(content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// A torch file with the given pickled object and its storages.
pub(crate) fn torch_file(object: &[u8], storages: &[(&str, &[u8])]) -> Vec<u8> {
    torch_file_of("little", object, storages)
}

pub(crate) fn torch_file_of(order: &str, object: &[u8], storages: &[(&str, &[u8])]) -> Vec<u8> {
    let names: Vec<String> =
        storages.iter().map(|(key, _)| format!("archive/data/{key}")).collect();
    let mut members: Vec<(&str, &[u8])> =
        vec![("archive/data.pkl", object), ("archive/byteorder", order.as_bytes())];
    members.extend(names.iter().zip(storages).map(|(name, (_, content))| (&name[..], *content)));
    archive(&members)
}

/// A Stable-Baselines3 archive around a torch file.
pub(crate) fn policy_archive(weights: &[u8]) -> Vec<u8> {
    archive(&[
        ("data", br#"{"num_timesteps": 7, "policy_kwargs": {}}"#),
        ("policy.pth", weights),
        ("_stable_baselines3_version", b"2.2.1"),
    ])
}

/// A policy whose state dictionary holds `action_net.weight` as described, and a storage of three ones.
pub(crate) fn policy_with(weight: Code) -> Vec<u8> {
    policy_archive(&torch_file(
        &pickle(&named(&[("action_net.weight", weight)])),
        &[("0", &ones(3))],
    ))
}

pub(crate) fn ones(count: usize) -> Vec<u8> {
    1.0_f32.to_le_bytes().repeat(count)
}

pub(crate) fn good_policy() -> Vec<u8> {
    policy_with(vector("0", 3))
}

/// A storage in torch's old stream format.
pub(crate) fn stream(little_endian: bool, count: i32, content: &[u8]) -> Vec<u8> {
    let magic = b"\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19";
    let system = named(&[("little_endian", boolean(little_endian))]);
    let key = text("k");
    let reference = tuple(&[
        text("storage"),
        global("torch.FloatStorage"),
        key.clone(),
        text("cpu"),
        int(count),
        none(),
    ]);
    let object = [&reference[..], b"Q"].concat();
    let pickles = [&magic[..], &int(1001), &system, &object, &list(&[key])].map(pickle).concat();
    [&pickles[..], &i64::from(count).to_le_bytes(), content].concat()
}

/// A tensor of ones whose storage is embedded in the pickle.
pub(crate) fn embedded(shape: &[i64]) -> Code {
    let count: i64 = shape.iter().product();
    let count = i32::try_from(count).unwrap();
    embedded_stream(shape, &stream(true, count, &ones(usize::try_from(count).unwrap())))
}

pub(crate) fn embedded_stream(shape: &[i64], stream: &[u8]) -> Code {
    let mut strides = vec![1; shape.len()];
    for axis in (1..shape.len()).rev() {
        strides[axis - 1] = strides[axis] * shape[axis];
    }
    tensor(call("torch.storage._load_from_bytes", &[bytes(stream)]), 0, shape, &strides)
}

/// An `mjrl` policy of two inputs, one layer, three outputs.
pub(crate) fn gradient_policy(in_shift: Code, nonlinearity: Code) -> Code {
    let parameters = named(&[("weight", embedded(&[3, 2])), ("bias", embedded(&[3]))]);
    let layer = object("torch.nn.modules.linear.Linear", &[("_parameters", parameters)]);
    let modules = named(&[("0", layer)]);
    let layers = object("torch.nn.modules.container.ModuleList", &[("_modules", modules)]);
    let network = [
        ("_modules", named(&[("fc_layers", layers)])),
        ("in_shift", in_shift),
        ("in_scale", embedded(&[2])),
        ("out_shift", embedded(&[3])),
        ("out_scale", embedded(&[3])),
        ("nonlinearity", nonlinearity),
    ];
    let model = object("mjrl.utils.fc_network.FCNetwork", &network);
    let attributes = [("model", model), ("log_std", embedded(&[3]))];
    pickle(&object("mjrl.policies.gaussian_mlp.MLP", &attributes))
}

pub(crate) fn tanh() -> Code {
    call("builtins.getattr", &[global("torch._C._VariableFunctions"), text("tanh")])
}

pub(crate) fn good_gradient_policy() -> Code {
    gradient_policy(embedded(&[2]), tanh())
}

/// `value` with the first occurrence of `from` replaced by `to`.
pub(crate) fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|window| window == from).unwrap();
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

/// `value` with every occurrence of `from` replaced by `to` of the same length.
pub(crate) fn replaced_everywhere(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut bytes = bytes.to_vec();
    while let Some(at) = bytes.windows(from.len()).position(|window| window == from) {
        bytes[at..at + to.len()].copy_from_slice(to);
    }
    bytes
}

/// Where the directory entry of `member` starts in an archive.
pub(crate) fn central_header(bytes: &[u8], member: &str) -> usize {
    const NAME_OFFSET: usize = 46;
    let is_entry = |window: &[u8]| {
        window.starts_with(b"PK\x01\x02") && &window[NAME_OFFSET..] == member.as_bytes()
    };
    bytes.windows(NAME_OFFSET + member.len()).rposition(is_entry).unwrap()
}

/// A `VecNormalize` pickle with `code` as an attribute that nobody reads.
pub(crate) fn smuggled(code: &[u8]) -> Vec<u8> {
    replaced(
        &good_component_normaliser(),
        &text("clip_obs"),
        &[&text("x"), code, &text("clip_obs")].concat(),
    )
}
