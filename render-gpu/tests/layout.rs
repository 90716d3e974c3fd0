//! Modules and records, without a GPU: each concatenation is valid WGSL, and records are the same bytes on
//! both sides.

use std::collections::BTreeSet;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use render_gpu::{records, source};

/// The whole text of a module, with the receiver of this crate where it takes one.
fn text(source: &source::Source) -> String {
    let receiver = if source.takes_receiver { render_gpu::DEFAULT_RECEIVER } else { "" };
    format!("{}{receiver}", source.text)
}

fn parsed() -> Vec<(&'static str, naga::Module)> {
    let parse = |source: &'static source::Source| {
        let text = text(source);
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{}: {}", source.name, error.emit_to_string(&text)));
        (source.name, module)
    };
    source::ALL.iter().map(parse).collect()
}

#[test]
fn every_module_is_valid_without_optional_features() {
    for (name, module) in parsed() {
        let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
        if let Err(error) = checked {
            panic!("{name}: {error:?}");
        }
        for entry in &module.entry_points {
            let size: u32 = entry.workgroup_size.iter().product();
            assert!(size <= 256, "{name}: `{}` has workgroups of {size}", entry.name);
        }
    }
}

#[test]
fn modules_have_names_of_their_own() {
    let names: BTreeSet<_> = source::ALL.iter().map(|source| source.name).collect();
    assert_eq!(names.len(), source::ALL.len());
}

/// What of a record differs from the structs of that name in these modules; `None` if no module has one.
fn difference(record: &records::Layout, modules: &[(&str, naga::Module)]) -> Option<Vec<String>> {
    let mut wrong = None;
    for (name, module) in modules {
        for (_, ty) in module.types.iter().filter(|(_, ty)| ty.name.as_deref() == Some(record.name)) {
            let naga::TypeInner::Struct { members, span } = &ty.inner else { continue };
            let wrong: &mut Vec<String> = wrong.get_or_insert_default();
            if *span as usize != record.size {
                wrong.push(format!("{name}: {} is {span} bytes, not {}", record.name, record.size));
            }
            let theirs: Vec<_> =
                members.iter().map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize)).collect();
            if theirs != record.fields {
                wrong.push(format!("{name}: {} has {theirs:?}, not {:?}", record.name, record.fields));
            }
        }
    }
    wrong
}

#[test]
fn records_are_the_same_bytes_on_both_sides() {
    let modules = parsed();
    for record in records::LAYOUTS
        .iter()
        .chain(render_gpu::rays::records::LAYOUTS)
        .chain(render_gpu::filter::LAYOUTS)
        .chain(render_gpu::shade::LAYOUTS)
    {
        let wrong = difference(record, &modules);
        assert_eq!(wrong, Some(vec![]), "{} has to be in some module, as it is here", record.name);
    }
}

/// The negative control of the test above.
#[test]
fn a_record_that_differs_is_found() {
    let modules = parsed();
    let right = records::LAYOUTS[0];
    assert_ne!(difference(&records::Layout { size: right.size + 16, ..right }, &modules), Some(vec![]));
    let mut fields = right.fields.to_vec();
    fields.swap(0, 1);
    let swapped = records::Layout { fields: Box::leak(fields.into_boxed_slice()), ..right };
    assert_ne!(difference(&swapped, &modules), Some(vec![]));
    assert_eq!(difference(&records::Layout { name: "NoSuchRecord", ..right }, &modules), None);
}

/// A file that no module includes is checked by nobody.
#[test]
fn every_file_is_in_a_module() {
    fn files(folder: &std::path::Path, found: &mut Vec<std::path::PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("shaders are beside the sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() { files(&path, found) } else { found.push(path) }
        }
    }
    let mut found = vec![];
    files(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders"), &mut found);
    assert!(!found.is_empty());
    for path in found {
        let text = std::fs::read_to_string(&path).expect("text");
        let is_used = source::ALL.iter().any(|source| self::text(source).contains(&text));
        assert!(is_used, "{} is in no module", path.display());
    }
}
