//! A look at the JSON text before it is parsed, for what the parser would not tell or not survive.
//!
//! - `{` and `[` are counted: a material of two characters, `{}`, takes half a kilobyte in memory.
//! - `NaN` and `Infinity`, which some exporters write, are no JSON. A parser names line and column, this the
//!   thing.
//! - The parser takes an index modulo 2³², so that 4294967296 would become a valid 0.
//!
//! Anything else that is wrong is left to the parser.

use std::ops::Range;

use super::{ImportLimits, ImportProblem};

/// How deep JSON may nest; the parser's own limit.
const MAX_DEPTH: usize = 127;

/// Keys whose values, or the values of whose items, are indices.
const INDEX_KEYS: [&str; 22] = [
    "accessor",
    "attributes",
    "buffer",
    "bufferView",
    "camera",
    "children",
    "index",
    "indices",
    "input",
    "joints",
    "light",
    "material",
    "mesh",
    "node",
    "nodes",
    "output",
    "sampler",
    "scene",
    "skeleton",
    "skin",
    "source",
    "targets",
];

/// One step from the root to where the scan is.
enum Step {
    /// Inside an object: the latest key, and whether its colon has been seen.
    Key(Range<usize>, bool),
    /// Inside an array: the current index.
    Item(usize),
}

/// Checks what the module's header lists.
pub(super) fn scan(json: &[u8], limits: &ImportLimits) -> Result<(), ImportProblem> {
    let mut path: Vec<Step> = Vec::new();
    let mut structures = 0_u64;
    let mut i = 0;
    while i < json.len() {
        match json[i] {
            b'"' => {
                let end = string_end(json, i);
                if let Some(Step::Key(key, false)) = path.last_mut() {
                    *key = i + 1..end;
                }
                i = end;
            }
            open @ (b'{' | b'[') => {
                structures += 1;
                if structures > limits.max_json_structures {
                    return Err(ImportProblem::Limit {
                        at: "JSON".to_owned(),
                        found: structures,
                        limit: limits.max_json_structures,
                        parameter: "max_json_structures",
                    });
                }
                path.push(if open == b'{' { Step::Key(0..0, false) } else { Step::Item(0) });
                if path.len() > MAX_DEPTH {
                    let why = format!("nested more than {MAX_DEPTH} deep");
                    return Err(ImportProblem::invalid(spell(json, &path[..8]), why, "flatten it"));
                }
            }
            b'}' | b']' => {
                path.pop();
            }
            b':' => {
                if let Some(Step::Key(_, colon)) = path.last_mut() {
                    *colon = true;
                }
            }
            b',' => match path.last_mut() {
                Some(Step::Key(_, colon)) => *colon = false,
                Some(Step::Item(index)) => *index += 1,
                None => {}
            },
            c if c.is_ascii_alphanumeric() || c == b'-' => {
                let token = i..i + bare_length(&json[i..]);
                check_token(json, &path, token.clone())?;
                i = token.end - 1;
            }
            _ => {}
        }
        i += 1;
    }
    Ok(())
}

/// Where the string that opens at `open` closes: the position of its quote, or the end of the text.
fn string_end(json: &[u8], open: usize) -> usize {
    let mut i = open + 1;
    while i < json.len() && json[i] != b'"' {
        i += if json[i] == b'\\' { 2 } else { 1 };
    }
    i.min(json.len())
}

/// Length of a number or word.
fn bare_length(text: &[u8]) -> usize {
    let bare = |c: &u8| c.is_ascii_alphanumeric() || matches!(c, b'-' | b'+' | b'.');
    text.iter().take_while(|c| bare(c)).count()
}

fn check_token(json: &[u8], path: &[Step], token: Range<usize>) -> Result<(), ImportProblem> {
    let text = str::from_utf8(&json[token]).unwrap_or("");
    let word = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    if matches!(word.as_str(), "nan" | "inf" | "infinity") {
        return Err(ImportProblem::invalid(
            spell(json, path),
            format!("is {text}, which is no number in JSON"),
            "write a finite number",
        ));
    }
    let too_large = text.len() >= 10
        && text.parse::<u64>().map_or(text.bytes().all(|c| c.is_ascii_digit()), |n| n > u64::from(u32::MAX));
    if too_large && path.iter().rev().take(3).any(|step| is_index_key(json, step)) {
        return Err(ImportProblem::invalid(
            spell(json, path),
            format!("index {text} does not fit into 32 bits"),
            "name something that is there",
        ));
    }
    Ok(())
}

fn is_index_key(json: &[u8], step: &Step) -> bool {
    matches!(step, Step::Key(key, _) if INDEX_KEYS.iter().any(|k| k.as_bytes() == &json[key.clone()]))
}

/// The path in the form `nodes[3].children[0]`.
fn spell(json: &[u8], path: &[Step]) -> String {
    let mut text = String::new();
    for step in path {
        match step {
            Step::Key(key, _) => {
                if !text.is_empty() {
                    text.push('.');
                }
                text.push_str(&String::from_utf8_lossy(&json[key.clone()]));
            }
            Step::Item(index) => text.push_str(&format!("[{index}]")),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(json: &str) -> Option<String> {
        scan(json.as_bytes(), &ImportLimits::default()).err().map(|e| e.to_string())
    }

    #[test]
    fn sound_json_passes() {
        assert_eq!(message(r#"{"a":[1,2.5e3,{"b":"NaN \" [4294967296"}],"byteLength":5000000000}"#), None);
        assert_eq!(message("]]}}\"\\"), None, "broken JSON is the parser's business");
    }

    #[test]
    fn words_that_are_no_numbers_are_named_by_their_path() {
        let json = r#"{"x":{"lights":[{"intensity":1},{"color":[1,1,1],"intensity":NaN}]}}"#;
        assert!(message(json).unwrap().starts_with("x.lights[1].intensity: is NaN"));
        assert!(message(r#"{"m":[0,-Infinity]}"#).unwrap().starts_with("m[1]: is -Infinity"));
    }

    #[test]
    fn indices_past_32_bits_are_refused() {
        assert!(
            message(r#"{"nodes":[{"mesh":4294967296}]}"#)
                .unwrap()
                .starts_with("nodes[0].mesh: index 4294967296")
        );
        assert!(message(r#"{"nodes":[{"children":[0,99999999999999999999999]}]}"#).is_some());
        assert!(message(r#"{"attributes":{"POSITION":4294967296}}"#).is_some());
        assert_eq!(message(r#"{"nodes":[{"mesh":4294967295}]}"#), None);
    }

    #[test]
    fn nesting_and_number_of_structures_are_bounded() {
        assert!(message(&"[".repeat(200)).unwrap().contains("deep"));
        let limits = ImportLimits { max_json_structures: 10, ..ImportLimits::default() };
        assert!(scan("[{},{},{},{},{}]".as_bytes(), &limits).is_ok());
        assert!(scan("[{},{},{},{},{},[],[],[],[],[]]".as_bytes(), &limits).is_err());
    }
}
