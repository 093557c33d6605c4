//! Writes checkpoints as PyTorch does, both forms, for tests that must not depend on it.
#![allow(dead_code, reason = "every test file takes what it needs")]

use half::f16;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A tensor and how it is stored.
#[derive(Debug, Clone)]
pub struct Saved {
    pub name: String,
    pub shape: Vec<u64>,
    pub numbers: Vec<f32>,
    /// `FloatStorage`, `HalfStorage` or `DoubleStorage`.
    pub kind: &'static str,
    /// In numbers; row-major where `None`.
    pub strides: Option<Vec<u64>>,
    /// Numbers of the storage before the tensor's first.
    pub offset: u32,
}

impl Saved {
    pub fn new(name: &str, shape: &[u64], numbers: Vec<f32>) -> Self {
        Self {
            name: name.into(),
            shape: shape.into(),
            numbers,
            kind: "FloatStorage",
            strides: None,
            offset: 0,
        }
    }

    fn storage(&self) -> Vec<u8> {
        let before = std::iter::repeat_n(7.0, self.offset as usize);
        let all = before.chain(self.numbers.iter().copied());
        match self.kind {
            "HalfStorage" => all.flat_map(|v| f16::from_f32(v).to_le_bytes()).collect(),
            "DoubleStorage" => all.flat_map(|v| f64::from(v).to_le_bytes()).collect(),
            _ => all.flat_map(f32::to_le_bytes).collect(),
        }
    }

    fn stored(&self) -> usize {
        self.offset as usize + self.numbers.len()
    }

    fn steps(&self) -> Vec<u64> {
        let mut steps = vec![1; self.shape.len()];
        for i in (1..self.shape.len()).rev() {
            steps[i - 1] = steps[i] * self.shape[i];
        }
        self.strides.clone().unwrap_or(steps)
    }
}

fn uniform(rng: &mut Pcg64, count: usize, bound: f32) -> Vec<f32> {
    (0..count)
        .map(|_| rng.random_range(-bound..bound))
        .collect()
}

/// Channels in and out of conv1_1 to conv4_1.
pub const CHANNELS: [[u64; 2]; 9] = [
    [3, 64],
    [64, 64],
    [64, 128],
    [128, 128],
    [128, 256],
    [256, 256],
    [256, 256],
    [256, 256],
    [256, 512],
];
/// Their indices in torchvision's network, and in the normalised `Sequential`.
pub const TORCHVISION: [u32; 9] = [0, 2, 5, 7, 10, 12, 14, 16, 19];
pub const SEQUENTIAL: [u32; 9] = [2, 5, 9, 12, 16, 19, 22, 25, 29];

/// Random filters of VGG-19's shapes with the keys `prefix` + index, whose activations stay of one
/// size from layer to layer, then some of the layers that nobody asks for.
pub fn random_vgg19(seed: u64, prefix: &str, indices: [u32; 9]) -> Vec<Saved> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut tensors = Vec::new();
    for ([inputs, outputs], index) in CHANNELS.into_iter().zip(indices) {
        let count = (inputs * outputs * 9) as usize;
        let bound = (6.0 / (inputs * 9) as f32).sqrt();
        let mut add = |part: &str, shape: &[u64], numbers| {
            tensors.push(Saved::new(
                &format!("{prefix}{index}.{part}"),
                shape,
                numbers,
            ));
        };
        add(
            "weight",
            &[outputs, inputs, 3, 3],
            uniform(&mut rng, count, bound),
        );
        add("bias", &[outputs], uniform(&mut rng, outputs as usize, 0.1));
    }
    tensors.push(Saved::new(
        "classifier.6.bias",
        &[10],
        uniform(&mut rng, 10, 1.0),
    ));
    tensors
}

/// The instructions of a pickle of protocol 2.
#[derive(Default)]
pub struct Pickler {
    pub bytes: Vec<u8>,
    globals: Vec<String>,
}

impl Pickler {
    pub fn start() -> Self {
        Self {
            bytes: vec![0x80, 2],
            globals: Vec::new(),
        }
    }

    pub fn op(&mut self, op: u8) -> &mut Self {
        self.bytes.push(op);
        self
    }

    pub fn text(&mut self, text: &str) -> &mut Self {
        self.op(b'X');
        self.bytes.extend((text.len() as u32).to_le_bytes());
        self.bytes.extend(text.as_bytes());
        self
    }

    pub fn int(&mut self, int: u64) -> &mut Self {
        if let Ok(byte) = u8::try_from(int) {
            self.bytes.extend([b'K', byte]);
        } else if let Ok(short) = u16::try_from(int) {
            self.op(b'M').bytes.extend(short.to_le_bytes());
        } else if let Ok(long) = i32::try_from(int) {
            self.op(b'J').bytes.extend(long.to_le_bytes());
        } else {
            self.bytes.extend([0x8a, 8]);
            self.bytes.extend(int.to_le_bytes());
        }
        self
    }

    /// A function, from the memo if it was named before.
    pub fn global(&mut self, module: &str, name: &str) -> &mut Self {
        let both = format!("{module}\n{name}\n");
        if let Some(at) = self.globals.iter().position(|known| *known == both) {
            self.bytes.extend([b'h', at as u8]);
        } else {
            self.op(b'c');
            self.bytes.extend(both.as_bytes());
            self.bytes.extend([b'q', self.globals.len() as u8]);
            self.globals.push(both);
        }
        self
    }

    fn sizes(&mut self, sizes: &[u64]) -> &mut Self {
        self.op(b'(');
        for size in sizes {
            self.int(*size);
        }
        self.op(b't')
    }

    /// Storage, offset, shape and strides of a tensor.
    fn tensor(&mut self, tensor: &Saved, key: &str, old: bool) {
        self.op(b'(').text("storage").global("torch", tensor.kind);
        self.text(key).text("cpu").int(tensor.stored() as u64);
        if old {
            self.op(b'N');
        }
        self.op(b't').op(b'Q').int(u64::from(tensor.offset));
        self.sizes(&tensor.shape).sizes(&tensor.steps());
    }

    /// An `OrderedDict` without entries.
    fn ordered(&mut self) -> &mut Self {
        self.global("collections", "OrderedDict").op(b')').op(b'R')
    }
}

/// `data.pkl` of a state dictionary, as PyTorch 2 writes it.
fn state_dictionary(tensors: &[Saved]) -> Vec<u8> {
    let mut p = Pickler::start();
    p.ordered().op(b'(');
    for (key, tensor) in tensors.iter().enumerate() {
        p.text(&tensor.name);
        p.global("torch._utils", "_rebuild_tensor_v2").op(b'(');
        p.tensor(tensor, &key.to_string(), false);
        p.op(0x89).ordered().op(b't').op(b'R');
    }
    p.op(b'u');
    // The versions of the layers, which are attributes of the dictionary.
    p.op(b'}').text("_metadata").ordered().op(b's').op(b'b');
    p.op(b'.');
    p.bytes
}

/// A checkpoint of PyTorch 1.6 and later.
pub fn zip_form(tensors: &[Saved], folder: &str) -> Vec<u8> {
    let mut files = vec![
        ("data.pkl".to_owned(), state_dictionary(tensors)),
        ("byteorder".to_owned(), b"little".to_vec()),
    ];
    for (key, tensor) in tensors.iter().enumerate() {
        files.push((format!("data/{key}"), tensor.storage()));
    }
    files.push(("version".to_owned(), b"3\n".to_vec()));
    zip(folder, &files, 0)
}

/// Stored entries that start at multiples of 64 bytes, as PyTorch lays them out. Checksums are 0.
pub fn zip(folder: &str, files: &[(String, Vec<u8>)], method: u16) -> Vec<u8> {
    let (mut all, mut list) = (Vec::new(), Vec::new());
    for (name, contents) in files {
        let name = format!("{folder}/{name}");
        let head = all.len();
        let extra = 4 + (64 - (head + 30 + name.len() + 4) % 64) % 64;
        let common = |extra: usize| {
            let sizes = [0, contents.len() as u32, contents.len() as u32];
            let names = [name.len() as u16, extra as u16];
            let mut common = [0, 0, method, 0, 0].map(u16::to_le_bytes).concat();
            common.extend(sizes.map(u32::to_le_bytes).concat());
            common.extend(names.map(u16::to_le_bytes).concat());
            common
        };
        all.extend(b"PK\x03\x04");
        all.extend(common(extra));
        all.extend(name.as_bytes());
        all.extend(b"FB");
        all.extend(((extra - 4) as u16).to_le_bytes());
        all.extend(std::iter::repeat_n(b'Z', extra - 4));
        all.extend(contents);
        list.extend(b"PK\x01\x02\x00\x00");
        list.extend(common(0));
        list.extend([0; 10]);
        list.extend((head as u32).to_le_bytes());
        list.extend(name.as_bytes());
    }
    let start = all.len() as u32;
    all.extend(&list);
    all.extend(b"PK\x05\x06\x00\x00\x00\x00");
    let count = (files.len() as u16).to_le_bytes();
    all.extend([count, count].concat());
    all.extend((list.len() as u32).to_le_bytes());
    all.extend(start.to_le_bytes());
    all.extend([0, 0]);
    all
}

/// What a stream begins with: magic number, protocol, system.
pub fn stream_head(little_endian: bool) -> Vec<u8> {
    let mut all = vec![0x80, 2, 0x8a, 10];
    all.extend([
        0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19, b'.',
    ]);
    all.extend([0x80, 2, b'M', 0xe9, 3, b'.']);
    let mut p = Pickler::start();
    p.op(b'}').op(b'(').text("protocol_version").int(1001);
    p.text("little_endian")
        .op(if little_endian { 0x88 } else { 0x89 });
    p.text("type_sizes")
        .op(b'}')
        .op(b'(')
        .text("int")
        .int(4)
        .op(b'u');
    p.op(b'u').op(b'.');
    all.extend(p.bytes);
    all
}

/// A checkpoint of PyTorch 0.1.10, of whose time torchvision's VGG files are: parameters around
/// tensors, and tensors that know nothing of gradients.
pub fn stream_form(tensors: &[Saved]) -> Vec<u8> {
    let mut all = stream_head(true);
    // Addresses in memory, which were the keys then.
    let keys: Vec<String> = (0..tensors.len())
        .map(|i| (94_300_000 - 16 * i).to_string())
        .collect();
    let mut p = Pickler::start();
    // Python 2 hands over a list of lists.
    p.global("collections", "OrderedDict").op(b']').op(b'(');
    for (key, tensor) in keys.iter().zip(tensors) {
        p.op(b']').op(b'(').text(&tensor.name);
        p.global("torch.nn.parameter", "Parameter");
        p.global("torch._utils", "_rebuild_tensor").op(b'(');
        p.tensor(tensor, key, true);
        p.op(b't').op(b'R').op(0x85).op(b'R');
        p.op(0x88).op(0x89).op(b'N').op(0x87).op(b'b');
        p.op(b'e');
    }
    p.op(b'e').op(0x85).op(b'R').op(b'.');
    all.extend(p.bytes);
    let mut sorted: Vec<(&String, &Saved)> = keys.iter().zip(tensors).collect();
    sorted.sort_by_key(|(key, _)| *key);
    let mut p = Pickler::start();
    p.op(b']').op(b'(');
    for (key, _) in &sorted {
        p.text(key);
    }
    p.op(b'e').op(b'.');
    all.extend(p.bytes);
    for (_, tensor) in sorted {
        all.extend((tensor.stored() as u64).to_le_bytes());
        all.extend(tensor.storage());
    }
    all
}
