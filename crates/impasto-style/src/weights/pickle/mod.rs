//! A restricted reader of Python pickles: dictionaries of tensors, as PyTorch saves them.
//!
//! A pickle is a program that may call any function. This reader knows the few functions that make
//! tensors and runs none; whatever else a pickle names is refused by that name.

mod machine;
mod objects;

pub(crate) use objects::{Storage, Tensor};

use machine::PickleMachine;
use objects::{Object, Objects, Value};

/// Most bytes of one pickle. Names and shapes of a large network are some hundred kilobytes.
pub(crate) const LONGEST: usize = 4 << 20;
/// What a pickle made.
#[derive(Debug)]
pub(crate) struct Pickle {
    objects: Objects,
    root: Value,
}

impl Pickle {
    /// Reads the pickle that `bytes` begin with, and how many bytes it takes.
    pub(crate) fn read(bytes: &[u8]) -> Result<(Self, usize), String> {
        let mut machine = PickleMachine::new(bytes);
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

    /// A flag of a dictionary.
    pub(crate) fn flag(&self, key: &str) -> Option<bool> {
        let mut entries = self.objects.dict(self.root)?.iter();
        match entries.find(|(k, _)| self.objects.text(*k) == Some(key))?.1 {
            Value::Bool(flag) => Some(flag),
            _ => None,
        }
    }

    /// A list of texts.
    pub(crate) fn texts(&self) -> Option<Vec<&str>> {
        let items = self.objects.list(self.root)?.iter();
        items.map(|item| self.objects.text(*item)).collect()
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
        let objects = &self.objects;
        let entries = objects.dict(self.root)?.iter();
        Some(entries.filter_map(|(key, value)| {
            let Some(Object::Tensor(tensor)) = objects.get(*value) else {
                return None;
            };
            Some((
                objects.text(*key)?,
                tensor,
                objects.storage(tensor.storage)?,
            ))
        }))
    }
}
