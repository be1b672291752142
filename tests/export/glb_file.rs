//! A minimal GLB reader and editor that shares no code with the library.

use serde_json::Value;
use vbgs_studio::model::splat::splats::Splat;

#[derive(Clone)]
pub struct Glb {
    pub json: Value,
    pub bin: Vec<u8>,
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

impl Glb {
    /// Parses a GLB and checks the container.
    pub fn parse(bytes: &[u8]) -> Self {
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!((word(bytes, 4), word(bytes, 8)), (2, bytes.len()));
        let n_json = word(bytes, 12);
        assert_eq!((n_json % 4, &bytes[16..20]), (0, &b"JSON"[..]));
        let json = &bytes[20..20 + n_json];
        assert!(json.trim_ascii_end().len() + 4 > n_json && json.trim_ascii_start() == json);
        let bin = &bytes[20 + n_json..];
        let n_bin = word(bin, 0);
        assert_eq!((n_bin % 4, &bin[4..8], bin.len()), (0, &b"BIN\0"[..], 8 + n_bin));
        Self { json: serde_json::from_slice(json).unwrap(), bin: bin[8..].to_vec() }
    }

    pub fn to_bytes(&self) -> Vec<u8> {
        let mut json = serde_json::to_vec(&self.json).unwrap();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let total = 28 + json.len() + bin.len();
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend((total as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &bin)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        bytes
    }

    pub fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    pub fn attribute(&self, semantic: &str) -> usize {
        let attributes = &self.json["meshes"][0]["primitives"][0]["attributes"];
        attributes[semantic].as_u64().unwrap() as usize
    }

    pub fn accessor(&mut self, semantic: &str) -> &mut Value {
        let index = self.attribute(semantic);
        &mut self.json["accessors"][index]
    }

    pub fn view(&mut self, semantic: &str) -> &mut Value {
        let index = self.accessor(semantic)["bufferView"].as_u64().unwrap() as usize;
        &mut self.json["bufferViews"][index]
    }

    /// Rows of a float attribute; checks that its view lies inside the data.
    pub fn floats(&self, semantic: &str) -> Vec<Vec<f32>> {
        let accessor = &self.json["accessors"][self.attribute(semantic)];
        assert_eq!(accessor["componentType"], 5126);
        let width = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => panic!("{other}"),
        };
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let (start, length) = (
            view["byteOffset"].as_u64().unwrap() as usize,
            view["byteLength"].as_u64().unwrap() as usize,
        );
        assert_eq!(length as u64, accessor["count"].as_u64().unwrap() * width as u64 * 4);
        let words: Vec<f32> = self.bin[start..start + length]
            .as_chunks()
            .0
            .iter()
            .map(|&b| f32::from_le_bytes(b))
            .collect();
        words.chunks(width).map(<[f32]>::to_vec).collect()
    }

    pub fn splats(&self) -> Vec<Splat> {
        let column = |name: &str| self.floats(&format!("KHR_gaussian_splatting:{name}"));
        let (rotation, scale, opacity) = (column("ROTATION"), column("SCALE"), column("OPACITY"));
        let sh = column("SH_DEGREE_0_COEF_0");
        let splat = |(i, mean): (usize, Vec<f32>)| Splat {
            mean: mean.try_into().unwrap(),
            opacity: opacity[i][0],
            color: std::array::from_fn(|c| 0.5 + 0.282_094_8 * sh[i][c]),
            scale: scale[i].clone().try_into().unwrap(),
            rotation: [rotation[i][3], rotation[i][0], rotation[i][1], rotation[i][2]],
        };
        self.floats("POSITION").into_iter().enumerate().map(splat).collect()
    }

    /// Appends a view with `bytes` and makes the accessor of an attribute use it.
    pub fn replace(&mut self, semantic: &str, bytes: &[u8], accessor: Value) {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = serde_json::json!({
            "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()
        });
        self.bin.extend(bytes);
        self.json["buffers"][0]["byteLength"] = self.bin.len().into();
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(view);
        let index = views.len() - 1;
        *self.accessor(semantic) = accessor;
        self.accessor(semantic)["bufferView"] = index.into();
    }
}
