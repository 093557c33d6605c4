//! The stack machine that a pickle is a program for.

use super::objects::{Function, Object, Objects, Storage, Tensor, Value};
use std::collections::HashMap;

/// Most values that one pickle may make: what bounds memory, as copies cost few bytes of program.
const MOST_VALUES: usize = 1 << 20;
/// Most dimensions of a tensor.
const MOST_DIMENSIONS: usize = 8;

/// A program under way.
pub(super) struct PickleMachine<'a> {
    bytes: &'a [u8],
    pub(super) at: usize,
    /// Values that may still be made.
    left: usize,
    stack: Vec<Value>,
    marks: Vec<usize>,
    memo: HashMap<u32, Value>,
    pub(super) objects: Objects,
}

const TOO_MANY: &str = "makes more values than a network has";
const SHORT: &str = "ends too early";
const CONFUSED: &str = "is not what PyTorch writes";

impl<'a> PickleMachine<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 0,
            left: MOST_VALUES,
            stack: Vec::new(),
            marks: Vec::new(),
            memo: HashMap::new(),
            objects: Objects::default(),
        }
    }

    /// Obeys one instruction; the result is there when it was the last one.
    pub(super) fn step(&mut self) -> Result<Option<Value>, String> {
        match self.byte()? {
            0x80 => drop(self.take(1)?),
            0x95 => drop(self.take(8)?),
            b'.' => return self.pop().map(Some),
            b'(' => {
                self.spend(1)?;
                self.marks.push(self.stack.len());
            }
            b'N' => self.push(Value::None)?,
            0x88 => self.push(Value::Bool(true))?,
            0x89 => self.push(Value::Bool(false))?,
            b'K' => self.push_int(1, false)?,
            b'M' => self.push_int(2, false)?,
            b'J' => self.push_int(4, true)?,
            0x8a => {
                let length = self.length(1)?;
                self.push_int(length, true)?;
            }
            b'G' => {
                self.take(8)?;
                self.push(Value::Float)?;
            }
            b'U' | 0x8c => self.push_text(1)?,
            b'T' | b'X' => self.push_text(4)?,
            b'}' => self.make(Object::Dict(Vec::new()))?,
            b']' => self.make(Object::List(Vec::new()))?,
            b')' => self.make(Object::Tuple(Vec::new()))?,
            b't' => {
                let items = self.marked()?;
                self.make(Object::Tuple(items))?;
            }
            count @ 0x85..=0x87 => {
                let first = self.stack.len().checked_sub(usize::from(count - 0x84));
                let items = self.stack.split_off(first.ok_or(CONFUSED)?);
                self.make(Object::Tuple(items))?;
            }
            b'q' => self.remember(1)?,
            b'r' => self.remember(4)?,
            0x94 => {
                let place = u32::try_from(self.memo.len()).map_err(|_| CONFUSED)?;
                self.remember_at(place)?;
            }
            b'h' => self.recall(1)?,
            b'j' => self.recall(4)?,
            other => self.act(other)?,
        }
        Ok(None)
    }

    /// The instructions that change or make something of several values.
    fn act(&mut self, instruction: u8) -> Result<(), String> {
        match instruction {
            b'a' => {
                let item = self.pop()?;
                self.append(&[item])
            }
            b'e' => {
                let items = self.marked()?;
                self.append(&items)
            }
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.set_items(&[key, value])
            }
            b'u' => {
                let items = self.marked()?;
                self.set_items(&items)
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.make(Object::Function(Function::named(&module, &name)?))
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let function = Function::named(self.text(module)?, self.text(name)?)?;
                self.make(Object::Function(function))
            }
            b'Q' => {
                let id = self.pop()?;
                let storage = self.storage(id)?;
                // A copy of a text that may be long.
                self.spend(storage.key.len())?;
                self.make(Object::Storage(storage))
            }
            b'R' => self.call(),
            b'b' => {
                let _state = self.pop()?;
                // Hooks of a parameter and versions of a network's layers, which say nothing of
                // the numbers.
                match self.stack.last().and_then(|value| self.objects.get(*value)) {
                    Some(Object::Dict(_) | Object::Tensor(_)) => Ok(()),
                    _ => Err(CONFUSED.into()),
                }
            }
            other => Err(format!(
                "uses the instruction 0x{other:02x}, which no dictionary of tensors needs"
            )),
        }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count).ok_or(SHORT)?;
        let taken = self.bytes.get(self.at..end).ok_or(SHORT)?;
        self.at = end;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, String> {
        Ok(self.take(1)?[0])
    }

    /// A little-endian number of at most 16 bytes.
    fn number(&mut self, bytes: usize, signed: bool) -> Result<i128, String> {
        if bytes > 16 {
            return Err(format!("holds an integer of {bytes} bytes"));
        }
        let taken = self.take(bytes)?;
        let negative = signed && taken.last().is_some_and(|top| top & 0x80 != 0);
        let mut all = [if negative { 0xff } else { 0 }; 16];
        all[..bytes].copy_from_slice(taken);
        Ok(i128::from_le_bytes(all))
    }

    fn length(&mut self, bytes: usize) -> Result<usize, String> {
        usize::try_from(self.number(bytes, false)?).map_err(|_| SHORT.into())
    }

    fn line(&mut self) -> Result<String, String> {
        let rest = self.bytes.get(self.at..).ok_or(SHORT)?;
        let length = rest.iter().position(|b| *b == b'\n').ok_or(SHORT)?;
        let line = String::from_utf8_lossy(&rest[..length]).into_owned();
        self.at += length + 1;
        Ok(line)
    }

    fn spend(&mut self, values: usize) -> Result<(), String> {
        self.left = (self.left.checked_sub(values)).ok_or(TOO_MANY)?;
        Ok(())
    }

    fn push(&mut self, value: Value) -> Result<(), String> {
        self.spend(1)?;
        self.stack.push(value);
        Ok(())
    }

    fn push_int(&mut self, bytes: usize, signed: bool) -> Result<(), String> {
        let value = Value::Int(self.number(bytes, signed)?);
        self.push(value)
    }

    fn push_text(&mut self, bytes: usize) -> Result<(), String> {
        let length = self.length(bytes)?;
        let text = std::str::from_utf8(self.take(length)?).map_err(|_| CONFUSED)?;
        let text = Object::Text(text.to_owned());
        self.make(text)
    }

    fn make(&mut self, object: Object) -> Result<(), String> {
        self.spend(1)?;
        self.stack.push(self.objects.add(object));
        Ok(())
    }

    fn pop(&mut self) -> Result<Value, String> {
        // Not below a mark that is still open.
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(CONFUSED.into());
        }
        self.stack.pop().ok_or_else(|| CONFUSED.into())
    }

    fn marked(&mut self) -> Result<Vec<Value>, String> {
        let mark = self.marks.pop().ok_or(CONFUSED)?;
        if mark > self.stack.len() {
            return Err(CONFUSED.into());
        }
        Ok(self.stack.split_off(mark))
    }

    fn remember(&mut self, bytes: usize) -> Result<(), String> {
        let place = u32::try_from(self.number(bytes, false)?).map_err(|_| CONFUSED)?;
        self.remember_at(place)
    }

    fn remember_at(&mut self, place: u32) -> Result<(), String> {
        self.spend(1)?;
        let value = *self.stack.last().ok_or(CONFUSED)?;
        self.memo.insert(place, value);
        Ok(())
    }

    fn recall(&mut self, bytes: usize) -> Result<(), String> {
        let place = u32::try_from(self.number(bytes, false)?).map_err(|_| CONFUSED)?;
        let value = *self.memo.get(&place).ok_or(CONFUSED)?;
        self.push(value)
    }

    /// The object on top of the stack, to be changed.
    fn top(&mut self) -> Result<&mut Object, String> {
        let top = self.stack.last().copied();
        let object = top.and_then(|value| self.objects.get_mut(value));
        object.ok_or_else(|| CONFUSED.into())
    }

    fn text(&self, value: Value) -> Result<&str, String> {
        self.objects.text(value).ok_or_else(|| CONFUSED.into())
    }

    fn tuple(&self, value: Value) -> Result<&[Value], String> {
        self.objects.tuple(value).ok_or_else(|| CONFUSED.into())
    }

    fn append(&mut self, items: &[Value]) -> Result<(), String> {
        let Object::List(list) = self.top()? else {
            return Err(CONFUSED.into());
        };
        list.extend_from_slice(items);
        Ok(())
    }

    fn set_items(&mut self, items: &[Value]) -> Result<(), String> {
        let (pairs, rest) = items.as_chunks::<2>();
        match self.top()? {
            Object::Dict(entries) if rest.is_empty() => {
                entries.extend(pairs.iter().map(|[key, value]| (*key, *value)));
                Ok(())
            }
            _ => Err(CONFUSED.into()),
        }
    }

    /// `("storage", kind, key, device, length)`, in the older form with a sixth entry for views.
    fn storage(&self, id: Value) -> Result<Storage, String> {
        let (kind, key, length) = match *self.tuple(id)? {
            [tag, kind, key, _, length] | [tag, kind, key, _, length, Value::None]
                if self.text(tag)? == "storage" =>
            {
                (kind, key, length)
            }
            _ => return Err("has a storage that is a view or of an unknown form".into()),
        };
        let Some(Object::Function(Function::Storage(number))) = self.objects.get(kind) else {
            return Err(CONFUSED.into());
        };
        Ok(Storage {
            number: *number,
            key: self.text(key)?.to_owned(),
            length: natural(length)?,
        })
    }

    fn call(&mut self) -> Result<(), String> {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let arguments = self.tuple(arguments)?;
        let Some(&Object::Function(function)) = self.objects.get(function) else {
            return Err(CONFUSED.into());
        };
        match (function, arguments) {
            (Function::OrderedDict, []) => self.make(Object::Dict(Vec::new())),
            (Function::OrderedDict, [pairs]) => {
                let entries = self.pairs(*pairs)?;
                self.spend(entries.len())?;
                self.make(Object::Dict(entries))
            }
            (Function::RebuildTensor, [storage, offset, shape, strides, ..]) => {
                let tensor = self.tensor(*storage, *offset, *shape, *strides)?;
                self.make(Object::Tensor(tensor))
            }
            (Function::Wrap, &[inner, ..]) => match self.objects.get(inner) {
                Some(Object::Tensor(_)) => self.push(inner),
                _ => Err(CONFUSED.into()),
            },
            _ => Err(CONFUSED.into()),
        }
    }

    /// A list of pairs, as Python 2 hands them to `OrderedDict`.
    fn pairs(&self, list: Value) -> Result<Vec<(Value, Value)>, String> {
        let list = self.objects.list(list).ok_or(CONFUSED)?;
        let pair = |item: &Value| {
            let pair = self.objects.list(*item).or(self.objects.tuple(*item));
            match pair {
                Some(&[key, value]) => Ok((key, value)),
                _ => Err(CONFUSED.into()),
            }
        };
        if list.len() > self.left {
            return Err(TOO_MANY.into());
        }
        list.iter().map(pair).collect()
    }

    fn tensor(
        &self,
        storage: Value,
        offset: Value,
        shape: Value,
        strides: Value,
    ) -> Result<Tensor, String> {
        self.objects.storage(storage).ok_or(CONFUSED)?;
        let (shape, strides) = (self.tuple(shape)?, self.tuple(strides)?);
        if shape.len() != strides.len() || shape.len() > MOST_DIMENSIONS {
            return Err(CONFUSED.into());
        }
        let all = |sizes: &[Value]| -> Result<Vec<u64>, String> {
            sizes.iter().map(|size| natural(*size)).collect()
        };
        Ok(Tensor {
            storage,
            offset: natural(offset)?,
            shape: all(shape)?,
            strides: all(strides)?,
        })
    }
}

fn natural(value: Value) -> Result<u64, String> {
    match value {
        Value::Int(int) => u64::try_from(int).map_err(|_| CONFUSED.into()),
        _ => Err(CONFUSED.into()),
    }
}
