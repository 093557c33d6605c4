//! What a pickle is about: values, the objects that they stand for, and the few functions that it
//! may name.

use crate::weights::number::Number;

/// A value; larger ones are in the pickle's list of objects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value {
    None,
    Bool(bool),
    /// Wide enough for the magic number of PyTorch's older form.
    Int(i128),
    Float,
    Object(usize),
}

#[derive(Debug)]
pub(super) enum Object {
    Text(String),
    Tuple(Vec<Value>),
    List(Vec<Value>),
    Dict(Vec<(Value, Value)>),
    Function(Function),
    Storage(Storage),
    Tensor(Tensor),
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Function {
    OrderedDict,
    RebuildTensor,
    /// Parameters are what they wrap, whatever else they are given.
    Wrap,
    Storage(Number),
}

impl Function {
    pub(super) fn named(module: &str, name: &str) -> Result<Self, String> {
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
    pub(super) storage: Value,
    /// In numbers.
    pub offset: u64,
    pub shape: Vec<u64>,
    pub strides: Vec<u64>,
}

/// All objects of a pickle.
#[derive(Debug, Default)]
pub(super) struct Objects(Vec<Object>);

impl Objects {
    /// Takes an object in; returns what stands for it.
    pub(super) fn add(&mut self, object: Object) -> Value {
        self.0.push(object);
        Value::Object(self.0.len() - 1)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Object> {
        self.0.iter()
    }

    pub(super) fn get(&self, value: Value) -> Option<&Object> {
        match value {
            Value::Object(at) => self.0.get(at),
            _ => None,
        }
    }

    pub(super) fn get_mut(&mut self, value: Value) -> Option<&mut Object> {
        match value {
            Value::Object(at) => self.0.get_mut(at),
            _ => None,
        }
    }

    pub(super) fn text(&self, value: Value) -> Option<&str> {
        match self.get(value) {
            Some(Object::Text(text)) => Some(text),
            _ => None,
        }
    }

    pub(super) fn tuple(&self, value: Value) -> Option<&[Value]> {
        match self.get(value) {
            Some(Object::Tuple(items)) => Some(items),
            _ => None,
        }
    }

    pub(super) fn list(&self, value: Value) -> Option<&[Value]> {
        match self.get(value) {
            Some(Object::List(items)) => Some(items),
            _ => None,
        }
    }

    pub(super) fn dict(&self, value: Value) -> Option<&[(Value, Value)]> {
        match self.get(value) {
            Some(Object::Dict(entries)) => Some(entries),
            _ => None,
        }
    }

    pub(super) fn storage(&self, value: Value) -> Option<&Storage> {
        match self.get(value) {
            Some(Object::Storage(storage)) => Some(storage),
            _ => None,
        }
    }
}
