//! Checked access to buffers, views and accessors.
//!
//! The `gltf` crate's iterators compute `offset + stride · (count - 1) + size` unchecked and trust sparse
//! counts. Everything they rely on is proved here first, in 64-bit arithmetic that cannot overflow unnoticed.

use std::borrow::Cow;
use std::mem::size_of;

use gltf::accessor::{DataType, Dimensions, Item, Iter};
use gltf::{Accessor, Document, buffer};

use super::error::thing;
use super::files::Files;
use super::{ImportLimits, ImportProblem};

const REPAIR: &str = "export the file again";

/// The buffers' bytes, and how many accessor elements have been read.
pub(super) struct Buffers<'a> {
    data: Vec<Cow<'a, [u8]>>,
    elements: u64,
    max_elements: u64,
}

impl<'a> Buffers<'a> {
    /// Fetches every buffer; `bin` is the binary chunk of a `.glb`.
    pub(super) fn load(
        document: &Document,
        bin: Option<&'a [u8]>,
        files: &mut Files,
        limits: &ImportLimits,
    ) -> Result<Self, ImportProblem> {
        let mut data = Vec::with_capacity(document.buffers().len());
        for buffer in document.buffers() {
            let at = thing("buffer", buffer.index(), buffer.name());
            let bytes = match (buffer.source(), bin) {
                (buffer::Source::Uri(uri), _) => Cow::Owned(files.fetch(uri, &at)?),
                (buffer::Source::Bin, Some(bin)) if buffer.index() == 0 => Cow::Borrowed(bin),
                (buffer::Source::Bin, _) => {
                    return Err(ImportProblem::invalid(
                        at,
                        "has no uri and there is no binary chunk for it",
                        REPAIR,
                    ));
                }
            };
            if (bytes.len() as u64) < buffer.length() as u64 {
                let why = format!("says {} bytes but has {}", buffer.length(), bytes.len());
                return Err(ImportProblem::invalid(at, why, REPAIR));
            }
            data.push(bytes);
        }
        Ok(Self { data, elements: 0, max_elements: limits.max_accessor_elements })
    }

    /// The bytes of a view.
    pub(super) fn view(&self, view: &buffer::View<'_>) -> Result<&[u8], ImportProblem> {
        let bytes = &self.data[view.buffer().index()];
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| bytes.get(view.offset()..end)).ok_or_else(|| {
            let why = format!(
                "bytes {} to {} + {} lie outside its buffer of {}",
                view.offset(),
                view.offset(),
                view.length(),
                bytes.len()
            );
            ImportProblem::invalid(thing("bufferView", view.index(), view.name()), why, REPAIR)
        })
    }

    /// All elements of an accessor whose type the caller has checked to be `T`.
    pub(super) fn read<T: Item>(&mut self, accessor: Accessor<'_>) -> Result<Vec<T>, ImportProblem> {
        self.check::<T>(&accessor)?;
        let at = self.name(&accessor);
        let data = &self.data;
        let elements = Iter::<T>::new(accessor, |buffer| data.get(buffer.index()).map(|bytes| &bytes[..]));
        // Checked above, so this is never taken.
        elements.map(Iterator::collect).ok_or_else(|| ImportProblem::invalid(at, "cannot be read", REPAIR))
    }

    /// Proves that reading `accessor` as `T` stays inside the buffers and inside the limit.
    fn check<T: Item>(&mut self, accessor: &Accessor<'_>) -> Result<(), ImportProblem> {
        let bad = |why: String| Err(ImportProblem::invalid(self.name(accessor), why, REPAIR));
        if accessor.size() != size_of::<T>() {
            return bad(format!("has elements of {} bytes, not {}", accessor.size(), size_of::<T>()));
        }
        let count = accessor.count() as u64;
        if count == 0 {
            return bad("is empty".to_owned());
        }
        let elements = self.elements.saturating_add(count);
        if elements > self.max_elements {
            return Err(ImportProblem::Limit {
                at: self.name(accessor),
                found: elements,
                limit: self.max_elements,
                parameter: "max_accessor_elements",
            });
        }
        if let Some(view) = accessor.view() {
            self.check_run(accessor, &view, accessor.offset(), count, size_of::<T>())?;
        }
        if let Some(sparse) = accessor.sparse() {
            let replaced = sparse.count() as u64;
            if replaced == 0 || replaced > count {
                return bad(format!("replaces {replaced} of {count} elements"));
            }
            let (indices, values) = (sparse.indices(), sparse.values());
            self.check_run(
                accessor,
                &indices.view(),
                indices.offset(),
                replaced,
                indices.index_type().size(),
            )?;
            self.check_run(accessor, &values.view(), values.offset(), replaced, size_of::<T>())?;
            self.check_sparse_order(accessor, &indices, replaced as usize, count)?;
        } else if accessor.view().is_none() {
            return bad("has no data".to_owned());
        }
        self.elements = elements;
        Ok(())
    }

    /// `count` elements of `size` bytes from `offset` on, one each stride, lie inside `view`.
    fn check_run(
        &self,
        accessor: &Accessor<'_>,
        view: &buffer::View<'_>,
        offset: usize,
        count: u64,
        size: usize,
    ) -> Result<(), ImportProblem> {
        let length = self.view(view)?.len() as u64;
        let stride = view.stride().unwrap_or(size);
        let end = (stride as u64)
            .checked_mul(count - 1)
            .and_then(|last| last.checked_add(offset as u64))
            .and_then(|last| last.checked_add(size as u64));
        let why = if stride < size {
            format!("stride of {stride} bytes is less than an element's {size}")
        } else if end.is_none_or(|end| end > length) {
            format!(
                "{count} elements from byte {offset} on do not fit into bufferView {} of {length} bytes",
                view.index()
            )
        } else {
            return Ok(());
        };
        Err(ImportProblem::invalid(self.name(accessor), why, REPAIR))
    }

    /// Sparse indices rise and stay below `count`; otherwise the crate would skip values without a word.
    fn check_sparse_order(
        &self,
        accessor: &Accessor<'_>,
        indices: &gltf::accessor::sparse::Indices<'_>,
        replaced: usize,
        count: u64,
    ) -> Result<(), ImportProblem> {
        let view = indices.view();
        let size = indices.index_type().size();
        let bytes = &self.view(&view)?[indices.offset()..];
        let mut least = 0_u64;
        for element in bytes.chunks(view.stride().unwrap_or(size)).take(replaced) {
            let index = element[..size].iter().rev().fold(0_u64, |n, &byte| n << 8 | u64::from(byte));
            if index < least || index >= count {
                let why = format!("sparse index {index} is out of order or not below {count}");
                return Err(ImportProblem::invalid(self.name(accessor), why, REPAIR));
            }
            least = index + 1;
        }
        Ok(())
    }

    fn name(&self, accessor: &Accessor<'_>) -> String {
        thing("accessor", accessor.index(), accessor.name())
    }
}

/// The accessor's type in words, for messages.
pub(super) fn spell_type(accessor: &Accessor<'_>) -> String {
    let component = match accessor.data_type() {
        DataType::I8 => "i8",
        DataType::U8 => "u8",
        DataType::I16 => "i16",
        DataType::U16 => "u16",
        DataType::U32 => "u32",
        DataType::F32 => "f32",
    };
    let shape = match accessor.dimensions() {
        Dimensions::Scalar => "SCALAR",
        Dimensions::Vec2 => "VEC2",
        Dimensions::Vec3 => "VEC3",
        Dimensions::Vec4 => "VEC4",
        Dimensions::Mat2 => "MAT2",
        Dimensions::Mat3 => "MAT3",
        Dimensions::Mat4 => "MAT4",
    };
    let normalized = if accessor.normalized() { ", normalized" } else { "" };
    format!("{shape} of {component}{normalized}")
}
