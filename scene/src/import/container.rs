//! From a file's bytes to a validated glTF document.
//!
//! The `gltf` crate parses and validates the JSON; what surrounds it is read here, because the crate's reader
//! subtracts from lengths that it has not checked, and its validation indexes `POSITION` accessors unchecked.

use gltf::Document;
use gltf::json::validation::{Checked, Validate};
use gltf::json::{self, Root};
use gltf::mesh::Semantic;

use super::scan::scan;
use super::{ImportLimits, ImportProblem};

const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

const REPAIR: &str = "export the file again";

/// Splits and parses a `.glb` (told by its magic number) or `.gltf`; gives the document and the `BIN` chunk.
pub(super) fn parse<'a>(
    bytes: &'a [u8],
    limits: &ImportLimits,
) -> Result<(Document, Option<&'a [u8]>), ImportProblem> {
    let (json, bin) = if bytes.starts_with(b"glTF") { split_glb(bytes)? } else { (bytes, None) };
    // A byte order mark is not allowed, but some editors leave one.
    let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
    if json.iter().all(u8::is_ascii_whitespace) {
        return Err(ImportProblem::invalid("file", "is empty", "name a .glb or .gltf file"));
    }
    if bin.is_none() && !json.trim_ascii_start().starts_with(b"{") {
        return Err(ImportProblem::invalid(
            "file",
            "is neither glTF JSON nor binary glTF",
            "name a .glb or .gltf file",
        ));
    }
    if json.len() as u64 > limits.max_json_bytes {
        return Err(ImportProblem::Limit {
            at: "JSON".to_owned(),
            found: json.len() as u64,
            limit: limits.max_json_bytes,
            parameter: "max_json_bytes",
        });
    }
    scan(json, limits)?;
    let root: Root =
        json::deserialize::from_slice(json).map_err(|error| ImportProblem::invalid("JSON", error, REPAIR))?;
    validate(&root)?;
    Ok((Document::from_json_without_validation(root), bin))
}

/// The JSON chunk and the binary chunk of a `.glb` (glTF 2.0 specification, section 4.4).
fn split_glb(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ImportProblem> {
    let bad = |why: String| ImportProblem::invalid("binary glTF", why, REPAIR);
    let word = |at: usize| -> Option<u32> {
        bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(bad("ends within its header".to_owned()));
    };
    if version != 2 {
        return Err(bad(format!("is version {version}, not 2")));
    }
    if length as usize > bytes.len() {
        return Err(bad(format!("says {length} bytes but has {}, so it is cut short", bytes.len())));
    }
    let bytes = &bytes[..length as usize];
    let mut json = None;
    let mut bin = None;
    let mut at = 12;
    while at < bytes.len() {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else {
            return Err(bad(format!("ends within the chunk header at byte {at}")));
        };
        let chunk = (at + 8).checked_add(size as usize).and_then(|end| bytes.get(at + 8..end));
        let Some(chunk) = chunk else {
            return Err(bad(format!("chunk at byte {at} says {size} bytes but the file ends before")));
        };
        match kind {
            JSON_CHUNK if json.is_none() && at == 12 => json = Some(chunk),
            BIN_CHUNK if json.is_some() && bin.is_none() => bin = Some(chunk),
            // Other chunks are extensions, to be skipped.
            _ => {}
        }
        at += 8 + size as usize;
    }
    match json {
        Some(json) => Ok((json, bin)),
        None => Err(bad("has no JSON chunk in front".to_owned())),
    }
}

/// The crate's validation, with the checks before it that it needs and those after it that its wrappers need.
fn validate(root: &Root) -> Result<(), ImportProblem> {
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let position = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
            if position.is_some_and(|index| index.value() >= root.accessors.len()) {
                return Err(ImportProblem::invalid(
                    format!("meshes[{m}].primitives[{p}].attributes.POSITION"),
                    "index out of bounds",
                    "name an accessor that is there",
                ));
            }
        }
    }

    // Only the first complaint is kept: a hostile file can have millions.
    let mut first = None;
    root.validate(root, json::Path::new, &mut |path, error| {
        if first.is_none() {
            first = Some((path().to_string(), error));
        }
    });
    if let Some((path, error)) = first {
        use json::validation::Error;
        let mend = match error {
            Error::IndexOutOfBounds => "name something that is there",
            Error::Missing => "add it, or export the file again",
            Error::Unsupported => "export without this extension",
            _ => REPAIR,
        };
        let at = if path.is_empty() { "document".to_owned() } else { path };
        return Err(ImportProblem::invalid(at, error.to_string().to_lowercase(), mend));
    }

    for (i, camera) in root.cameras.iter().enumerate() {
        let perspective = matches!(camera.type_, Checked::Valid(json::camera::Type::Perspective));
        if perspective && camera.perspective.is_none() || !perspective && camera.orthographic.is_none() {
            return Err(ImportProblem::invalid(
                format!("cameras[{i}]"),
                "has no parameters of its type",
                REPAIR,
            ));
        }
    }
    for (i, image) in root.images.iter().enumerate() {
        let sourced = match (&image.buffer_view, &image.uri) {
            (Some(_), _) => image.mime_type.is_some(),
            (None, uri) => uri.is_some(),
        };
        if !sourced {
            let why = "has neither uri nor bufferView with mimeType";
            return Err(ImportProblem::invalid(format!("images[{i}]"), why, REPAIR));
        }
    }
    Ok(())
}
