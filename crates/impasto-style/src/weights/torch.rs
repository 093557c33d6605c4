//! PyTorch's two forms of a checkpoint: since 1.6 a zip file, before that a stream of pickles and
//! blocks of numbers (`torch.save`, `torch/serialization.py`).

use super::number::{Number, Stored};
use super::pickle::{LONGEST, Pickle, Storage, Tensor};
use super::source::ByteSource;
use super::zip;
use std::collections::{BTreeMap, HashMap};

/// What a stream begins with.
const MAGIC: i128 = 0x1950_a86a_20f9_469c_fc6c;
const PROTOCOL: i128 = 1001;
const BIG_ENDIAN: &str =
    "was written on a big-endian machine; load and save it again on a usual one";

type Stores = BTreeMap<String, Stored>;

/// Reads the zip form.
pub(crate) fn read_zip(source: &mut ByteSource) -> Result<Stores, String> {
    let entries = zip::entries(source)?;
    // The folder is named after the file as it was first called.
    let (folder, program) = entries
        .iter()
        .filter_map(|(name, entry)| Some((name.strip_suffix("data.pkl")?, *entry)))
        .filter(|(folder, _)| folder.is_empty() || folder.ends_with('/'))
        .min_by_key(|(folder, _)| (folder.len(), *folder))
        .ok_or("is a zip file without a data.pkl, not a PyTorch checkpoint")?;
    if let Some(order) = entries.get(&format!("{folder}byteorder"))
        && order.length <= 16
        && source.bytes(order.start, order.length)?.starts_with(b"big")
    {
        return Err(BIG_ENDIAN.into());
    }
    if program.length > LONGEST as u64 {
        return Err("has a data.pkl that is too long for a dictionary of tensors".into());
    }
    let (pickle, _) = Pickle::read(&source.bytes(program.start, program.length)?)?;
    located(&pickle, |storage| {
        let entry = entries
            .get(&format!("{folder}data/{}", storage.key))
            .ok_or_else(|| format!("lacks its entry data/{}", storage.key))?;
        if storage.length.checked_mul(storage.number.size()) != Some(entry.length) {
            let key = &storage.key;
            return Err(format!("has an entry data/{key} of a wrong length"));
        }
        Ok(entry.start)
    })
}

/// Reads the older form.
pub(crate) fn read_stream(source: &mut ByteSource) -> Result<Stores, String> {
    let head = source.bytes(0, source.length().min(LONGEST as u64))?;
    let mut at = 0;
    let mut next = || -> Result<Pickle, String> {
        let (pickle, length) = Pickle::read(&head[at..])?;
        at += length;
        Ok(pickle)
    };
    if next()?.int() != Some(MAGIC) || next()?.int() != Some(PROTOCOL) {
        return Err("does not begin like a PyTorch checkpoint".into());
    }
    if next()?.flag("little_endian") == Some(false) {
        return Err(BIG_ENDIAN.into());
    }
    let (pickle, keys) = (next()?, next()?);
    let keys = keys.texts().ok_or("has no list of its storages")?;
    let mut sizes: HashMap<&str, &Storage> = HashMap::new();
    for storage in pickle.storages() {
        if *sizes.entry(&storage.key).or_insert(storage) != storage {
            return Err(format!("has two storages \"{}\"", storage.key));
        }
    }
    let mut starts = HashMap::new();
    let mut place = at as u64;
    for key in keys {
        let storage = sizes
            .get(key)
            .ok_or_else(|| format!("has a storage \"{key}\" that nothing uses"))?;
        if source.number(place)? != storage.length {
            return Err(format!("has a storage \"{key}\" of a wrong length"));
        }
        let start = place + 8;
        let bytes = bytes_of(storage.length, storage.number)?;
        source.within(start, bytes)?;
        starts.insert(key, start);
        place = start + bytes;
    }
    located(&pickle, |storage| {
        let start = starts.get(storage.key.as_str()).copied();
        start.ok_or_else(|| format!("lacks its storage \"{}\"", storage.key))
    })
}

fn bytes_of(numbers: u64, number: Number) -> Result<u64, String> {
    (numbers.checked_mul(number.size())).ok_or_else(|| "claims impossible sizes".into())
}

/// Where the numbers of every tensor are, when storages start at `start_of`.
fn located(
    pickle: &Pickle,
    start_of: impl Fn(&Storage) -> Result<u64, String>,
) -> Result<Stores, String> {
    let tensors = pickle
        .tensors()
        .ok_or("holds no dictionary of tensors; save model.state_dict()")?;
    let mut stores = Stores::new();
    for (name, tensor, storage) in tensors {
        let numbers = checked_length(name, tensor)?;
        let end = tensor.offset.checked_add(numbers);
        if end.is_none_or(|end| end > storage.length) {
            return Err(format!(
                "has a tensor \"{name}\" that is larger than its storage"
            ));
        }
        let start = start_of(storage)? + bytes_of(tensor.offset, storage.number)?;
        let stored = Stored {
            number: storage.number,
            shape: tensor.shape.clone(),
            start,
        };
        stores.insert(name.to_owned(), stored);
    }
    Ok(stores)
}

/// How many numbers a tensor has, which must lie one after the other in its storage.
fn checked_length(name: &str, tensor: &Tensor) -> Result<u64, String> {
    let mut length = 1u64;
    for (size, stride) in tensor.shape.iter().zip(&tensor.strides).rev() {
        // Along a single pixel no step is ever taken.
        if *size != 1 && *stride != length {
            return Err(format!(
                "stores \"{name}\" with strides {:?} for shape {:?}; save it contiguous",
                tensor.strides, tensor.shape
            ));
        }
        length = length
            .checked_mul(*size)
            .ok_or_else(|| format!("claims an impossible shape for \"{name}\""))?;
    }
    Ok(length)
}
