//! glTF primitives to [`Mesh`]es.

use glam::{Vec2, Vec3};
use gltf::Accessor;
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::{Mode, Primitive, Semantic};

use super::accessor::{Buffers, spell_type};
use super::error::thing;
use super::{ImportProblem, Notes};
use crate::Mesh;

/// Converts one primitive of triangles; `None` for points, lines and strips too short for a triangle. The
/// mesh's material is left for the caller to set.
pub(super) fn convert(
    mesh: &gltf::Mesh<'_>,
    primitive: &Primitive<'_>,
    buffers: &mut Buffers<'_>,
    notes: &mut Notes,
) -> Result<Option<Mesh>, ImportProblem> {
    let at = format!("{}, primitive {}", thing("mesh", mesh.index(), mesh.name()), primitive.index());
    if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        notes.count("primitives of points or lines are left out".to_owned());
        return Ok(None);
    }
    let mut positions = read_positions(primitive, buffers, &at)?;
    let triangles = read_triangles(primitive, positions.len(), buffers, notes, &at)?;
    if triangles.is_empty() {
        notes.count("primitives without a whole triangle are left out".to_owned());
        return Ok(None);
    }
    let mut normals = read_normals(primitive, &positions, &triangles, buffers, notes, &at)?;
    let mut uvs = read_uvs(primitive, 0, positions.len(), buffers, &at)?;
    let mut uvs1 = read_uvs(primitive, 1, positions.len(), buffers, &at)?;
    let mut triangles = triangles;
    // Exporters let many primitives share one large array; each mesh keeps what its triangles use.
    if positions.len() > 3 * triangles.len() {
        let kept = renumber(&mut triangles, positions.len());
        gather(&mut positions, &kept);
        gather(&mut normals, &kept);
        gather(&mut uvs, &kept);
        gather(&mut uvs1, &kept);
    }
    if primitive.get(&Semantic::Colors(0)).is_some() {
        notes.count("primitives' vertex colours are ignored".to_owned());
    }
    if primitive.morph_targets().len() > 0 {
        notes.count("primitives' morph targets are ignored".to_owned());
    }
    Ok(Some(Mesh { positions, normals, uvs, uvs1, triangles, material: 0 }))
}

fn read_positions(
    primitive: &Primitive<'_>,
    buffers: &mut Buffers<'_>,
    at: &str,
) -> Result<Vec<Vec3>, ImportProblem> {
    let Some(accessor) = primitive.get(&Semantic::Positions) else {
        return Err(ImportProblem::invalid(at, "has no POSITION", "export it with positions"));
    };
    expect_type(&accessor, Dimensions::Vec3, &[DataType::F32], at, "POSITION")?;
    let positions: Vec<Vec3> = vectors(buffers.read::<[f32; 3]>(accessor)?);
    match positions.iter().position(|p| !p.is_finite()) {
        None => Ok(positions),
        Some(vertex) => Err(ImportProblem::invalid(
            at,
            format!("POSITION of vertex {vertex} is {}", positions[vertex]),
            "write finite numbers",
        )),
    }
}

/// The triangles of a list, strip or fan, with or without indices (glTF 2.0 specification, section 3.7.2.1).
fn read_triangles(
    primitive: &Primitive<'_>,
    vertices: usize,
    buffers: &mut Buffers<'_>,
    notes: &mut Notes,
    at: &str,
) -> Result<Vec<[u32; 3]>, ImportProblem> {
    let indices = match primitive.indices() {
        Some(accessor) => read_indices(accessor, vertices, buffers, at)?,
        None => (0..vertices as u32).collect(),
    };
    let windows = || indices.windows(3).enumerate();
    Ok(match primitive.mode() {
        Mode::TriangleStrip => windows()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect(),
        Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [indices[0], w[0], w[1]]).collect(),
        _ => {
            let (triangles, rest) = indices.as_chunks::<3>();
            if !rest.is_empty() {
                notes.say(format!("{at}: {} indices after the last whole triangle are left out", rest.len()));
            }
            triangles.to_vec()
        }
    })
}

fn read_indices(
    accessor: Accessor<'_>,
    vertices: usize,
    buffers: &mut Buffers<'_>,
    at: &str,
) -> Result<Vec<u32>, ImportProblem> {
    expect_type(&accessor, Dimensions::Scalar, &[DataType::U8, DataType::U16, DataType::U32], at, "indices")?;
    let indices: Vec<u32> = match accessor.data_type() {
        DataType::U8 => buffers.read::<u8>(accessor)?.into_iter().map(u32::from).collect(),
        DataType::U16 => buffers.read::<u16>(accessor)?.into_iter().map(u32::from).collect(),
        _ => buffers.read::<u32>(accessor)?,
    };
    match indices.iter().position(|&index| index as usize >= vertices) {
        None => Ok(indices),
        Some(i) => Err(ImportProblem::invalid(
            at,
            format!("index {i} names vertex {} of {vertices}", indices[i]),
            "export the file again",
        )),
    }
}

/// Unit normals, or none. A normal that has no direction is replaced by that of the faces around it.
fn read_normals(
    primitive: &Primitive<'_>,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    buffers: &mut Buffers<'_>,
    notes: &mut Notes,
    at: &str,
) -> Result<Vec<Vec3>, ImportProblem> {
    let Some(accessor) = primitive.get(&Semantic::Normals) else { return Ok(Vec::new()) };
    expect_type(&accessor, Dimensions::Vec3, &[DataType::F32], at, "NORMAL")?;
    expect_count(&accessor, positions.len(), at, "NORMAL")?;
    let mut normals: Vec<Vec3> = vectors(buffers.read::<[f32; 3]>(accessor)?);
    let mut missing = 0;
    for normal in &mut normals {
        // Scaled first, or the squares of tiny and huge components would be lost.
        let largest = normal.abs().max_element();
        *normal = (*normal / largest).try_normalize().unwrap_or(Vec3::ZERO);
        missing += usize::from(*normal == Vec3::ZERO);
    }
    if missing > 0 {
        notes.say(format!(
            "{at}: {missing} normals without direction are replaced by those of the faces around"
        ));
        let given: Vec<bool> = normals.iter().map(|&n| n != Vec3::ZERO).collect();
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| positions[i as usize]);
            let face = (b - a).cross(c - a);
            for &i in triangle.iter().filter(|&&i| !given[i as usize]) {
                normals[i as usize] += face;
            }
        }
        for (normal, given) in normals.iter_mut().zip(given) {
            if !given {
                let largest = normal.abs().max_element();
                *normal = (*normal / largest).try_normalize().unwrap_or(Vec3::Y);
            }
        }
    }
    Ok(normals)
}

fn read_uvs(
    primitive: &Primitive<'_>,
    set: u32,
    vertices: usize,
    buffers: &mut Buffers<'_>,
    at: &str,
) -> Result<Vec<Vec2>, ImportProblem> {
    let Some(accessor) = primitive.get(&Semantic::TexCoords(set)) else { return Ok(Vec::new()) };
    let what = format!("TEXCOORD_{set}");
    expect_type(&accessor, Dimensions::Vec2, &[DataType::F32, DataType::U8, DataType::U16], at, &what)?;
    expect_count(&accessor, vertices, at, &what)?;
    let uvs: Vec<Vec2> = match accessor.data_type() {
        DataType::F32 => buffers.read::<[f32; 2]>(accessor)?.into_iter().map(Vec2::from).collect(),
        DataType::U8 => buffers
            .read::<[u8; 2]>(accessor)?
            .into_iter()
            .map(|uv| Vec2::from(uv.map(f32::from)) / 255.0)
            .collect(),
        _ => {
            let uvs = buffers.read::<[u16; 2]>(accessor)?;
            uvs.into_iter().map(|uv| Vec2::from(uv.map(f32::from)) / 65535.0).collect()
        }
    };
    match uvs.iter().position(|uv| !uv.is_finite()) {
        None => Ok(uvs),
        Some(vertex) => Err(ImportProblem::invalid(
            at,
            format!("{what} of vertex {vertex} is {}", uvs[vertex]),
            "write finite numbers",
        )),
    }
}

/// Integers other than indices have to be normalized, as the specification says.
fn expect_type(
    accessor: &Accessor<'_>,
    dimensions: Dimensions,
    types: &[DataType],
    at: &str,
    what: &str,
) -> Result<(), ImportProblem> {
    let integer = accessor.data_type() != DataType::F32;
    let normalized = !integer || dimensions == Dimensions::Scalar || accessor.normalized();
    if accessor.dimensions() == dimensions && types.contains(&accessor.data_type()) && normalized {
        return Ok(());
    }
    let why = format!("{what} (accessor {}) has the wrong type {}", accessor.index(), spell_type(accessor));
    Err(ImportProblem::invalid(at, why, "export without quantisation"))
}

fn expect_count(accessor: &Accessor<'_>, vertices: usize, at: &str, what: &str) -> Result<(), ImportProblem> {
    if accessor.count() == vertices {
        return Ok(());
    }
    let why = format!("has {} {what} for {vertices} positions", accessor.count());
    Err(ImportProblem::invalid(at, why, "export the file again"))
}

fn vectors(arrays: Vec<[f32; 3]>) -> Vec<Vec3> {
    arrays.into_iter().map(Vec3::from).collect()
}

/// Renumbers vertices in the order of their first use; gives for each new number the old one.
fn renumber(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    const UNUSED: u32 = u32::MAX;
    let mut new = vec![UNUSED; vertices];
    let mut kept = Vec::new();
    for index in triangles.iter_mut().flatten() {
        let slot = &mut new[*index as usize];
        if *slot == UNUSED {
            *slot = kept.len() as u32;
            kept.push(*index);
        }
        *index = *slot;
    }
    kept
}

fn gather<T: Copy>(values: &mut Vec<T>, kept: &[u32]) {
    if !values.is_empty() {
        *values = kept.iter().map(|&i| values[i as usize]).collect();
    }
}
