//! A restricted reader of Python pickles: dictionaries of tensors, as PyTorch saves them.
//!
//! A pickle is a program that may call any function. This reader knows the few functions that make
//! tensors and runs none; whatever else a pickle names is refused by that name.

mod machine;

use super::number::Number;
use machine::Machine;

/// Most bytes of one pickle. Names and shapes of a large network are some hundred kilobytes.
pub(crate) const LONGEST: usize = 4 << 20;
/// A value; larger ones are in the pickle's list of objects.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Value {
    None,
    Bool(bool),
    /// Wide enough for the magic number of PyTorch's older form.
    Int(i128),
    Float,
    Object(usize),
}

#[derive(Debug)]
enum Object {
    Text(String),
    Tuple(Vec<Value>),
    List(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    Function(Function),
    Storage(Storage),
    Tensor(Tensor),
}

#[derive(Debug, Clone, Copy)]
enum Function {
    OrderedDict,
    RebuildTensor,
    /// Parameters are what they wrap, whatever else they are given.
    Wrap,
    Storage(Number),
}

impl Function {
    fn named(module: &str, name: &str) -> Result<Self, String> {
        Ok(match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_parameter") | ("torch.nn.parameter", "Parameter") => {
                Self::Wrap
            }
            ("torch", "HalfStorage") => Self::Storage(Number::F16),
            ("torch", "FloatStorage") => Self::Storage(Number::F32),
            ("torch", "DoubleStorage") => Self::Storage(Number::F64),
            _ => {
                return Err(format!(
                    "names {module}.{name}, which is refused because a checkpoint could run code \
                     that way; save the tensors alone (model.state_dict() in single precision)"
                ));
            }
        })
    }
}

/// A block of numbers outside the pickle.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Storage {
    pub number: Number,
    pub key: String,
    /// In numbers.
    pub length: u64,
}

/// Part of a [`Storage`].
#[derive(Debug)]
pub(crate) struct Tensor {
    storage: usize,
    /// In numbers.
    pub offset: u64,
    pub shape: Vec<u64>,
    pub strides: Vec<u64>,
}

/// What a pickle made.
#[derive(Debug)]
pub(crate) struct Pickle {
    objects: Vec<Object>,
    root: Value,
}

impl Pickle {
    /// Reads the pickle that `bytes` begin with, and how many bytes it takes.
    pub(crate) fn read(bytes: &[u8]) -> Result<(Self, usize), String> {
        let mut machine = Machine::new(bytes);
        loop {
            let at = machine.at;
            match machine.step() {
                Ok(None) => {}
                Ok(Some(root)) => {
                    let objects = machine.objects;
                    return Ok((Self { objects, root }, machine.at));
                }
                Err(reason) => {
                    return Err(format!("has a pickle that {reason} (at its byte {at})"));
                }
            }
        }
    }

    pub(crate) fn int(&self) -> Option<i128> {
        match self.root {
            Value::Int(int) => Some(int),
            _ => None,
        }
    }

    fn object(&self, value: Value) -> Option<&Object> {
        match value {
            Value::Object(at) => self.objects.get(at),
            _ => None,
        }
    }

    fn text(&self, value: Value) -> Option<&str> {
        match self.object(value) {
            Some(Object::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// A flag of a dictionary.
    pub(crate) fn flag(&self, key: &str) -> Option<bool> {
        let Some(Object::Dict(entries)) = self.object(self.root) else {
            return None;
        };
        let found = entries.iter().find(|(k, _)| self.text(*k) == Some(key))?;
        match found.1 {
            Value::Bool(flag) => Some(flag),
            _ => None,
        }
    }

    /// A list of texts.
    pub(crate) fn texts(&self) -> Option<Vec<&str>> {
        match self.object(self.root) {
            Some(Object::List(items)) => items.iter().map(|item| self.text(*item)).collect(),
            _ => None,
        }
    }

    /// All blocks of numbers that are spoken of.
    pub(crate) fn storages(&self) -> impl Iterator<Item = &Storage> {
        self.objects.iter().filter_map(|object| match object {
            Object::Storage(storage) => Some(storage),
            _ => None,
        })
    }

    /// The tensors of a dictionary with their names; other entries are left out.
    pub(crate) fn tensors(&self) -> Option<impl Iterator<Item = (&str, &Tensor, &Storage)>> {
        let Some(Object::Dict(entries)) = self.object(self.root) else {
            return None;
        };
        Some(entries.iter().filter_map(|(key, value)| {
            let Some(Object::Tensor(tensor)) = self.object(*value) else {
                return None;
            };
            match &self.objects[tensor.storage] {
                Object::Storage(storage) => Some((self.text(*key)?, tensor, storage)),
                _ => None,
            }
        }))
    }
}
