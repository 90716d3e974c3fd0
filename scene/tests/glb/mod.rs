//! Small glTF files made by code.

#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::{Path, PathBuf};

use image::ImageEncoder;

/// A glTF asset under construction: one buffer, views and accessors that fill it, and any other top-level
/// members.
#[derive(Clone, Default)]
pub(crate) struct Asset {
    pub(crate) bin: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
    members: Vec<(String, String)>,
}

impl Asset {
    /// Appends bytes as a view; `extra` may hold further JSON members, each with a comma in front.
    pub(crate) fn view(&mut self, bytes: &[u8], extra: &str) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let (offset, length) = (self.bin.len(), bytes.len());
        self.bin.extend_from_slice(bytes);
        self.views.push(format!(r#"{{"buffer":0,"byteOffset":{offset},"byteLength":{length}{extra}}}"#));
        self.views.len() - 1
    }

    pub(crate) fn accessor(&mut self, json: String) -> usize {
        self.accessors.push(json);
        self.accessors.len() - 1
    }

    /// Vectors of `N` floats, with the bounds that positions must have.
    pub(crate) fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, "");
        let count = values.len();
        let zeros = vec!["0"; N].join(",");
        self.accessor(format!(
            r#"{{"bufferView":{view},"componentType":5126,"count":{count},"type":"VEC{N}","min":[{zeros}],"max":[{zeros}]}}"#
        ))
    }

    /// Indices of 16 bits.
    pub(crate) fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let (view, count) = (self.view(&bytes, ""), values.len());
        self.accessor(format!(
            r#"{{"bufferView":{view},"componentType":5123,"count":{count},"type":"SCALAR"}}"#
        ))
    }

    /// Sets a top-level member.
    pub(crate) fn set(&mut self, key: &str, json: impl Into<String>) -> &mut Self {
        self.members.retain(|(known, _)| known != key);
        self.members.push((key.to_owned(), json.into()));
        self
    }

    pub(crate) fn json(&self) -> String {
        self.json_with_buffer(&format!(r#"{{"byteLength":{}}}"#, self.bin.len()))
    }

    /// The JSON with another description of its buffer.
    pub(crate) fn json_with_buffer(&self, buffer: &str) -> String {
        let mut json = r#"{"asset":{"version":"2.0"}"#.to_owned();
        if !self.bin.is_empty() {
            json += &format!(r#","buffers":[{buffer}]"#);
        }
        for (key, values) in [("bufferViews", &self.views), ("accessors", &self.accessors)] {
            if !values.is_empty() {
                json += &format!(r#","{key}":[{}]"#, values.join(","));
            }
        }
        for (key, value) in &self.members {
            json += &format!(r#","{key}":{value}"#);
        }
        json + "}"
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        glb(&self.json(), &self.bin)
    }
}

/// One triangle in the plane z = 0 with texture coordinates, one mesh, one node, one material of `material`
/// JSON.
pub(crate) fn triangle(material: &str) -> Asset {
    let mut asset = Asset::default();
    let positions = asset.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let uvs = asset.floats(&[[0.0_f32, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let indices = asset.indices(&[0, 1, 2]);
    let attributes = format!(r#"{{"POSITION":{positions},"TEXCOORD_0":{uvs}}}"#);
    asset.set(
        "meshes",
        format!(r#"[{{"primitives":[{{"attributes":{attributes},"indices":{indices},"material":0}}]}}]"#),
    );
    asset.set("materials", format!("[{material}]"));
    asset.set("nodes", r#"[{"mesh":0}]"#).set("scenes", r#"[{"nodes":[0]}]"#).set("scene", "0");
    asset
}

/// [`triangle`] with a PNG of `texels`, `width` wide, as texture 0.
pub(crate) fn textured_triangle(material: &str, width: u32, texels: &[[u8; 4]]) -> Asset {
    let mut asset = triangle(material);
    let view = asset.view(&png(width, texels), "");
    asset.set("images", format!(r#"[{{"bufferView":{view},"mimeType":"image/png"}}]"#));
    asset.set("textures", r#"[{"source":0}]"#);
    asset
}

pub(crate) fn png(width: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let height = texels.len() as u32 / width;
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(texels.as_flattened(), width, height, image::ExtendedColorType::Rgba8)
        .unwrap();
    bytes
}

pub(crate) fn jpeg(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let texels: Vec<u8> = (0..width * height * 3).map(|i| (i * 7) as u8).collect();
    image::codecs::jpeg::JpegEncoder::new(&mut bytes)
        .write_image(&texels, width, height, image::ExtendedColorType::Rgb8)
        .unwrap();
    bytes
}

/// A binary glTF of these two chunks.
pub(crate) fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let bin_chunk = if bin.is_empty() { 0 } else { 8 + bin.len() };
    let mut glb = b"glTF".to_vec();
    let word = |glb: &mut Vec<u8>, n: usize| glb.extend((n as u32).to_le_bytes());
    word(&mut glb, 2);
    word(&mut glb, 12 + 8 + json.len() + bin_chunk);
    word(&mut glb, json.len());
    glb.extend(b"JSON");
    glb.extend(json);
    if bin_chunk > 0 {
        word(&mut glb, bin.len());
        glb.extend(b"BIN\0");
        glb.extend(bin);
    }
    glb
}

/// A folder for one test's files, emptied at the start.
pub(crate) struct Folder(PathBuf);

impl Folder {
    pub(crate) fn new(test: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("scene-{test}"));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    /// Writes a file, with the folders it lies in.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
