//! The reference host's lights, surfaces and geometry as a device's records.

use core::f32::consts::FRAC_1_PI;

use bytemuck::cast_slice;
use lighttree::Receiver;
use render_gpu::ReceiverRecord;
use render_gpu::rays::{BinaryTree, Geometry, InstanceGeometry, MeshGeometry};
use render_gpu::shade::{EmitterRecord, SurfaceRecord};
use scene::bsdf::Bsdf;
use scene::{FlatRays, FlatTree, Light, Scene, ShadingPoint};

/// A pixel with nothing to be lit.
pub(crate) const NO_SURFACE: SurfaceRecord = SurfaceRecord {
    position: [0.0; 3],
    offset: 0.0,
    geometric_normal: [0.0; 3],
    stream: 0,
    normal: [0.0; 3],
    alpha: 0.0,
    view: [0.0; 3],
    f90: 0.0,
    base: [0.0; 3],
    interface_f0: 0.0,
    f0: [0.0; 3],
    interface_f90: 0.0,
};

/// Hands a scene's arrays to `upload`.
pub(crate) fn geometry<T>(flat: &FlatRays, upload: impl FnOnce(&Geometry<'_>) -> T) -> T {
    fn tree(tree: &FlatTree) -> BinaryTree<'_> {
        BinaryTree { nodes: cast_slice(&tree.nodes), order: &tree.order }
    }
    let meshes: Vec<_> = flat
        .meshes
        .iter()
        .map(|mesh| MeshGeometry { triangles: &mesh.triangles, tree: tree(&mesh.tree) })
        .collect();
    let instances: Vec<_> = flat
        .instances
        .iter()
        .map(|i| InstanceGeometry { mesh: i.mesh, first_primitive: i.first_primitive, to_world: i.to_world })
        .collect();
    let instances = (!flat.top.nodes.is_empty()).then(|| (&instances[..], tree(&flat.top)));
    upload(&Geometry { meshes: &meshes, instances })
}

/// A light as the device samples it.
pub(crate) fn emitter(scene: &Scene, light: &Light) -> EmitterRecord {
    match *light {
        Light::Point { position, intensity } => EmitterRecord::point(position, intensity),
        Light::Spot { position, axis, intensity, cos_inner, cos_outer } => {
            EmitterRecord::spot(position, axis, cos_inner, cos_outer, intensity)
        }
        Light::Vpl { position, normal, intensity } => EmitterRecord::cosine(position, normal, intensity),
        Light::Triangle { vertices, radiance, two_sided, .. } => {
            let offset = light.point_by_area(scene, [0.5; 2]).offset;
            EmitterRecord::triangle(vertices, radiance, two_sided, offset)
        }
    }
}

/// A point as the device draws lights for it.
pub(crate) fn receiver(point: &ShadingPoint) -> ReceiverRecord {
    // Where scattering has no such form (it is next to nothing), lights are drawn as for a white wall.
    ReceiverRecord::new(point).unwrap_or(ReceiverRecord {
        position: point.position().to_array(),
        diffuse: FRAC_1_PI,
        normal: point.normal.to_array(),
        ..ReceiverRecord::NONE
    })
}

/// A point as the device shades it; specular surfaces were followed to it.
pub(crate) fn surface(point: &ShadingPoint) -> SurfaceRecord {
    let placed = SurfaceRecord {
        position: point.position.to_array(),
        offset: point.offset,
        geometric_normal: point.geometric_normal.to_array(),
        stream: point.pixel,
        normal: point.normal.to_array(),
        view: point.wo.to_array(),
        ..NO_SURFACE
    };
    match &point.bsdf {
        Bsdf::Lambert { albedo } => SurfaceRecord { base: (*albedo * FRAC_1_PI).to_array(), ..placed },
        Bsdf::Ggx(ggx) => {
            let [interface_f0, interface_f90] = ggx.interface();
            SurfaceRecord {
                alpha: ggx.alpha(),
                f90: ggx.f90(),
                base: ggx.base().to_array(),
                interface_f0,
                f0: ggx.f0().to_array(),
                interface_f90,
                ..placed
            }
        }
        // An exponent of 0 would say that there is no lobe.
        Bsdf::Phong(phong) => SurfaceRecord {
            alpha: -phong.exponent.max(f32::MIN_POSITIVE),
            base: (phong.diffuse * FRAC_1_PI).to_array(),
            f0: phong.specular.to_array(),
            ..placed
        },
        Bsdf::Mirror { .. } | Bsdf::Dielectric(_) => placed,
    }
}
