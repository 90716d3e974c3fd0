//! Where in the lightmap each surface has its texels: UV charts, and a rectangle of a page for each object.
//!
//! Charts come from `uvunwrap`, whose output is the same bits on every platform and for any number of
//! threads. A mesh that is used many times is unwrapped once, and each object that shows it gets a rectangle
//! of its own.

use core::fmt;

use glam::{Affine3A, Vec2, Vec3};

/// A mesh as the host has it.
#[derive(Clone, Copy, Debug)]
pub struct MeshView<'a> {
    /// Vertex positions, in the mesh's space.
    pub positions: &'a [Vec3],
    /// Unit vertex normals; empty: flat shading.
    pub normals: &'a [Vec3],
    /// Vertex indices, counter-clockwise seen from the front.
    pub triangles: &'a [[u32; 3]],
    /// Lightmap coordinates to be kept as they are, one a vertex, in [0, 1]; empty: charts are made.
    pub kept_uvs: &'a [Vec2],
}

/// A mesh in one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectView {
    /// Index of its mesh.
    pub mesh: u32,
    /// Mesh to world; invertible.
    pub to_world: Affine3A,
}

/// How charts are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutParams {
    /// Texels per world length unit, along an edge.
    pub texels_per_unit: f32,
    /// Width and height of a page in texels, at most; more pages are taken as needed.
    pub page_size: u32,
    /// Empty texels around each chart: 2 keep bicubic lookups from bleeding, 1 bilinear ones.
    pub padding: u32,
    /// Texels of all pages together that may be taken, as memory goes with them.
    pub max_texels: u64,
}

impl Default for LayoutParams {
    fn default() -> Self {
        Self { texels_per_unit: 4.0, page_size: 4096, padding: 2, max_texels: 1 << 26 }
    }
}

/// Why there is no lightmap.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum LayoutError {
    /// A parameter is out of its range.
    Params {
        /// Which and why.
        why: String,
    },
    /// An object or mesh that isn't one.
    Object {
        /// Index of the object.
        object: u32,
        /// What is wrong with it.
        why: String,
    },
    /// A mesh that cannot be unwrapped, or whose kept coordinates are none.
    Mesh {
        /// Index of the mesh.
        mesh: u32,
        /// What is wrong with it.
        why: String,
    },
    /// More texels than allowed.
    TooLarge {
        /// Texels that the density asks for, about.
        texels: u64,
        /// Texels allowed.
        allowed: u64,
        /// A density that fits.
        texels_per_unit: f32,
    },
}

impl fmt::Display for LayoutError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Params { why } => write!(f, "lightmap: {why}"),
            Self::Object { object, why } => write!(f, "object {object}: {why}"),
            Self::Mesh { mesh, why } => write!(f, "mesh {mesh}: {why}"),
            Self::TooLarge { texels, allowed, texels_per_unit } => write!(
                f,
                "the lightmap would take {:.3e} texels, {allowed} are allowed: take {texels_per_unit:.3e} texels per unit or fewer",
                *texels as f64
            ),
        }
    }
}

impl core::error::Error for LayoutError {}

/// A mesh with its charts: vertices on chart borders are there more than once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChartedMesh {
    /// Index of the host's mesh.
    pub mesh: u32,
    /// For each vertex, the host's vertex that it is.
    pub vertices: Vec<u32>,
    /// For each vertex, its place in the mesh's own layout, in [0, 1].
    pub uvs: Vec<Vec2>,
    /// The host's triangles in the host's order, by index into `vertices`.
    pub triangles: Vec<[u32; 3]>,
    /// Whether the coordinates are the host's own.
    pub kept: bool,
}

/// An object's rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Index into [`Layout::meshes`].
    pub charted: u32,
    /// Page that it is on.
    pub page: u32,
    /// Corner with the smallest coordinates, in texels.
    pub min: Vec2,
    /// Opposite corner, in texels.
    pub max: Vec2,
}

impl Placement {
    /// A place in the mesh's own layout, in texels of the page.
    pub fn texel(&self, uv: Vec2) -> Vec2 {
        self.min + uv * (self.max - self.min)
    }

    /// The texels that the rectangle touches: first column and row, and one beyond the last.
    pub fn pixels(&self) -> ([u32; 2], [u32; 2]) {
        let (min, max) = (self.min.floor(), self.max.ceil());
        ([min.x as u32, min.y as u32], [max.x as u32, max.y as u32])
    }
}

/// Every surface's place in the lightmap.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    /// Width and height of all pages, texels.
    pub size: [u32; 2],
    /// Number of pages.
    pub pages: u32,
    /// Meshes with charts; a host's mesh that is shown at very different scales is there once for each.
    pub meshes: Vec<ChartedMesh>,
    /// One for each object; `None` for those without triangles, or with none that is wider than a millionth
    /// of the mesh.
    pub objects: Vec<Option<Placement>>,
    /// Charts over all meshes.
    pub charts: u32,
}

impl Layout {
    /// Makes charts for all objects, but for meshes that bring their own.
    ///
    /// # Errors
    /// [`LayoutError`], which names the object or mesh.
    pub fn build(
        meshes: &[MeshView<'_>],
        objects: &[ObjectView],
        params: &LayoutParams,
    ) -> Result<Self, LayoutError> {
        check_params(params)?;
        let scales = scales(meshes, objects)?;
        check_texels(meshes, objects, &scales, params)?;
        let groups = groups(meshes, objects, &scales);
        if groups.is_empty() {
            return Ok(Self { objects: vec![None; objects.len()], ..Self::default() });
        }

        // Unwrap each group; a mesh that keeps its coordinates is a square of the same area.
        let inputs: Vec<Input> = groups.iter().map(|group| Input::new(group, meshes, &scales)).collect();
        let views: Vec<_> = inputs.iter().map(Input::view).collect();
        // One page that grows is what most scenes need; what outgrows it takes several.
        let unwrap = |page| uvunwrap::generate(&views, &options(params, page)).map_err(|e| refused(&e));
        let mut atlas = unwrap(None)?;
        if atlas.width.max(atlas.height) > params.page_size {
            atlas = unwrap(Some(params.page_size))?;
        }

        let mut layout = Self {
            size: [atlas.width, atlas.height],
            pages: atlas.page_count,
            meshes: Vec::with_capacity(groups.len()),
            objects: vec![None; objects.len()],
            charts: atlas.chart_count,
        };
        let size = Vec2::new(atlas.width as f32, atlas.height as f32);
        for ((group, input), output) in groups.iter().zip(&inputs).zip(&atlas.meshes) {
            let charted = layout.meshes.len() as u32;
            layout.meshes.push(input.charted(group, &meshes[group.mesh as usize], output));
            for (&object, rect) in group.objects.iter().zip(&output.instances) {
                let (min, max) = (Vec2::from(rect.min) * size, Vec2::from(rect.max) * size);
                layout.objects[object as usize] = Some(Placement { charted, page: rect.page, min, max });
            }
        }
        Ok(layout)
    }

    /// Texels of all pages.
    pub fn texels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1]) * u64::from(self.pages)
    }
}

/// Objects that show one mesh at about one scale.
struct Group {
    mesh: u32,
    objects: Vec<u32>,
    kept: bool,
}

/// What is handed to the unwrapper for a group.
struct Input {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
    scales: Vec<f32>,
}

impl Input {
    fn new(group: &Group, meshes: &[MeshView<'_>], scales: &[f32]) -> Self {
        let mesh = &meshes[group.mesh as usize];
        let scales = group.objects.iter().map(|&object| scales[object as usize]).collect();
        if group.kept {
            let side = area(mesh).sqrt().max(f64::from(f32::MIN_POSITIVE)) as f32;
            let positions = vec![[0.0, 0.0, 0.0], [side, 0.0, 0.0], [side, side, 0.0], [0.0, side, 0.0]];
            return Self { positions, indices: vec![0, 1, 2, 0, 2, 3], scales };
        }
        let positions = mesh.positions.iter().map(|p| p.to_array()).collect();
        Self { positions, indices: mesh.triangles.iter().flatten().copied().collect(), scales }
    }

    fn view(&self) -> uvunwrap::MeshInput<'_> {
        uvunwrap::MeshInput {
            instance_scales: &self.scales,
            ..uvunwrap::MeshInput::new(&self.positions, &self.indices)
        }
    }

    fn charted(&self, group: &Group, mesh: &MeshView<'_>, output: &uvunwrap::OutputMesh) -> ChartedMesh {
        if group.kept {
            return ChartedMesh {
                mesh: group.mesh,
                vertices: (0..mesh.positions.len() as u32).collect(),
                uvs: mesh.kept_uvs.to_vec(),
                triangles: mesh.triangles.to_vec(),
                kept: true,
            };
        }
        ChartedMesh {
            mesh: group.mesh,
            vertices: output.vertices.iter().map(|v| v.xref).collect(),
            uvs: output.vertices.iter().map(|v| Vec2::from(v.uv)).collect(),
            triangles: output.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            kept: false,
        }
    }
}

fn options(params: &LayoutParams, page_size: Option<u32>) -> uvunwrap::Options {
    uvunwrap::Options {
        density: uvunwrap::Density::Fixed { texels_per_unit: params.texels_per_unit, page_size },
        padding: params.padding,
        packing: uvunwrap::Packing::Fast,
        // What is larger than a page is baked more coarsely instead of not at all.
        max_chart_size: params.page_size - 2 * params.padding - 1,
        ..uvunwrap::Options::default()
    }
}

fn check_params(params: &LayoutParams) -> Result<(), LayoutError> {
    let fail = |why: String| Err(LayoutError::Params { why });
    if !(params.texels_per_unit > 0.0 && params.texels_per_unit.is_finite()) {
        return fail(format!("{} texels per unit: a positive number is needed", params.texels_per_unit));
    }
    if !(16..=16384).contains(&params.page_size) {
        return fail(format!("a page of {} texels: from 16 to 16384", params.page_size));
    }
    if params.padding > 7 {
        return fail(format!("a padding of {} texels: at most 7", params.padding));
    }
    Ok(())
}

/// The length that a unit of each object's mesh has in the world, along its most stretched axis.
fn scales(meshes: &[MeshView<'_>], objects: &[ObjectView]) -> Result<Vec<f32>, LayoutError> {
    for (index, mesh) in meshes.iter().enumerate() {
        let fail = |why: String| Err(LayoutError::Mesh { mesh: index as u32, why });
        let vertices = mesh.positions.len() as u32;
        if let Some(bad) = mesh.triangles.iter().flatten().find(|&&v| v >= vertices) {
            return fail(format!("vertex {bad} of {vertices}"));
        }
        if let Some(bad) = mesh.positions.iter().position(|p| !p.is_finite()) {
            return fail(format!("vertex {bad} is not finite"));
        }
        if !mesh.normals.is_empty() && mesh.normals.len() != mesh.positions.len() {
            return fail(format!("{} normals for {vertices} vertices", mesh.normals.len()));
        }
        if !mesh.kept_uvs.is_empty() {
            if mesh.kept_uvs.len() != mesh.positions.len() {
                return fail(format!("{} lightmap coordinates for {vertices} vertices", mesh.kept_uvs.len()));
            }
            let inside = |uv: &Vec2| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all();
            if let Some(bad) = mesh.kept_uvs.iter().position(|uv| !inside(uv)) {
                return fail(format!(
                    "the lightmap coordinate of vertex {bad} is {}: those that are kept lie in [0, 1]",
                    mesh.kept_uvs[bad]
                ));
            }
        }
    }
    let scale = |(index, object): (usize, &ObjectView)| {
        let fail = |why: &str| Err(LayoutError::Object { object: index as u32, why: why.to_owned() });
        if object.mesh as usize >= meshes.len() {
            return fail("its mesh is not there");
        }
        let matrix = object.to_world.matrix3;
        let largest = matrix.x_axis.length().max(matrix.y_axis.length()).max(matrix.z_axis.length());
        if !object.to_world.is_finite() || !largest.is_finite() {
            return fail("its transform is not finite");
        }
        if matrix.determinant() == 0.0 {
            return fail("its transform flattens it");
        }
        Ok(largest)
    };
    objects.iter().enumerate().map(scale).collect()
}

/// Area of a mesh in its own space.
fn area(mesh: &MeshView<'_>) -> f64 {
    let triangle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    };
    mesh.triangles.iter().map(triangle).sum()
}

fn check_texels(
    meshes: &[MeshView<'_>],
    objects: &[ObjectView],
    scales: &[f32],
    params: &LayoutParams,
) -> Result<(), LayoutError> {
    let areas: Vec<f64> = meshes.iter().map(area).collect();
    let world: f64 =
        objects.iter().zip(scales).map(|(o, &s)| areas[o.mesh as usize] * f64::from(s) * f64::from(s)).sum();
    // Charts fill two thirds of their rectangles, about.
    let texels = world * f64::from(params.texels_per_unit).powi(2) * 1.5;
    if texels <= params.max_texels as f64 {
        return Ok(());
    }
    let fits = f64::from(params.texels_per_unit) * (params.max_texels as f64 / texels).sqrt();
    Err(LayoutError::TooLarge {
        texels: texels as u64,
        allowed: params.max_texels,
        texels_per_unit: (0.95 * fits) as f32,
    })
}

/// Whether the unwrapper makes a chart of anything in the mesh: it leaves out triangles thinner than a
/// millionth of the mesh's extent, and can't take a mesh of which nothing is left.
fn has_place(mesh: &MeshView<'_>) -> bool {
    if !mesh.kept_uvs.is_empty() {
        return !mesh.triangles.is_empty();
    }
    let mut positions = mesh.positions.iter().map(|p| p.as_dvec3());
    let first = positions.next().unwrap_or_default();
    let (low, high) = positions.fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
    let thinnest = 2e-6 * (high - low).length();
    mesh.triangles.iter().any(|t| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        (b - a).cross(c - a).length() > thinnest * longest
    })
}

/// Objects by mesh, then by octave of scale: padding is laid out for the smallest of a group.
fn groups(meshes: &[MeshView<'_>], objects: &[ObjectView], scales: &[f32]) -> Vec<Group> {
    let key = |object: u32| (objects[object as usize].mesh, scales[object as usize].log2().floor() as i32);
    let have_place: Vec<bool> = meshes.iter().map(has_place).collect();
    let mut order: Vec<u32> =
        (0..objects.len() as u32).filter(|&o| have_place[objects[o as usize].mesh as usize]).collect();
    order.sort_by_key(|&object| (key(object), object));
    let by_key = order.chunk_by(|&a, &b| key(a) == key(b));
    by_key
        .map(|objects| {
            let mesh = key(objects[0]).0;
            Group { mesh, objects: objects.to_vec(), kept: !meshes[mesh as usize].kept_uvs.is_empty() }
        })
        .collect()
}

/// What is wrong with meshes was found before; what is left are sizes.
fn refused(error: &uvunwrap::Error) -> LayoutError {
    let why = match error {
        uvunwrap::Error::ChartTooLarge { width, height, page_size } => format!(
            "an object takes {width}x{height} texels, a page has {page_size}x{page_size}: take larger pages or fewer texels per unit"
        ),
        other => other.to_string(),
    };
    LayoutError::Params { why }
}

#[cfg(test)]
mod tests {
    use super::{Layout, LayoutParams, MeshView, ObjectView};
    use glam::{Affine3A, Vec3};

    #[test]
    fn what_is_but_points_and_lines_has_no_place() {
        let points = [Vec3::ZERO; 3];
        let line = [Vec3::ZERO, Vec3::X, 2.0 * Vec3::X];
        let sliver = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1e-30, 0.0)];
        let speck = [Vec3::ZERO, 1e-25 * Vec3::X, 1e-25 * Vec3::Y];
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let of = |positions: &[&[Vec3; 3]]| {
            let meshes: Vec<_> = positions
                .iter()
                .map(|&positions| MeshView {
                    positions,
                    normals: &[],
                    triangles: &[[0, 1, 2], [0, 0, 1]],
                    kept_uvs: &[],
                })
                .collect();
            let object = |mesh| ObjectView { mesh, to_world: Affine3A::IDENTITY };
            let objects: Vec<_> = (0..meshes.len() as u32).map(object).collect();
            let layout = Layout::build(&meshes, &objects, &LayoutParams::default()).unwrap();
            layout.objects.iter().map(Option::is_some).collect::<Vec<_>>()
        };
        assert_eq!(of(&[&points]), [false]);
        assert_eq!(of(&[&line]), [false]);
        assert_eq!(of(&[&sliver]), [false]);
        assert_eq!(of(&[&speck]), [true]);
        assert_eq!(of(&[&sliver, &points, &triangle, &speck]), [false, false, true, true]);
    }
}
