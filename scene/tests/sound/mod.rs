//! What the tests of importer and built-in scenes share.

#![allow(dead_code, reason = "each test binary uses its own part")]

use lighttree::Emitter;
use scene::{Light, Scene};

/// Everything that [`Scene`] promises: indices in range, numbers finite, unit vectors of length one.
pub(crate) fn assert_sound(scene: &Scene) {
    let unit = |v: glam::Vec3| (v.length() - 1.0).abs() < 1e-3;
    for (i, mesh) in scene.meshes.iter().enumerate() {
        let vertices = mesh.positions.len();
        assert!((mesh.material as usize) < scene.materials.len(), "mesh {i}");
        assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < vertices), "mesh {i}");
        assert!(mesh.positions.iter().all(|p| p.is_finite()), "mesh {i}");
        assert!(mesh.normals.is_empty() || mesh.normals.len() == vertices, "mesh {i}");
        assert!(mesh.normals.iter().all(|&n| unit(n)), "mesh {i}");
        for uvs in [&mesh.uvs, &mesh.uvs1] {
            assert!(uvs.is_empty() || uvs.len() == vertices, "mesh {i}");
            assert!(uvs.iter().all(|uv| uv.is_finite()), "mesh {i}");
        }
    }
    for instance in &scene.instances {
        assert!((instance.mesh as usize) < scene.meshes.len());
        assert!(instance.to_world.is_finite() && instance.to_world.inverse().is_finite());
    }
    for material in &scene.materials {
        let slots =
            [material.base_color_texture, material.metallic_roughness_texture, material.emissive_texture];
        for slot in slots.into_iter().flatten() {
            assert!((slot.texture as usize) < scene.textures.len() && slot.uv_set <= 1);
            assert!(slot.transform.is_finite());
        }
        assert!(material.emissive.is_finite() && material.emissive.min_element() >= 0.0);
        assert!(material.base_color.is_finite() && material.ior.is_finite());
    }
    for texture in &scene.textures {
        assert!(texture.width > 0 && texture.height > 0);
        assert_eq!(texture.texels.len(), (texture.width * texture.height) as usize);
    }
    for (i, light) in scene.lights.iter().enumerate() {
        let bounds = light.bounds();
        assert!(bounds.intensity > 0.0 && bounds.intensity.is_finite(), "light {i}: {light:?}");
        assert!(
            bounds.min.is_finite() && bounds.max.is_finite() && unit(bounds.axis),
            "light {i}: {light:?}"
        );
        if let Light::Triangle { instance, triangle, .. } = *light {
            let mesh = &scene.meshes[scene.instances[instance as usize].mesh as usize];
            assert!((triangle as usize) < mesh.triangles.len(), "light {i}");
        }
    }
    for camera in &scene.cameras {
        let frame = [camera.forward, camera.right, camera.up];
        assert!(frame.into_iter().all(unit) && camera.position.is_finite());
        assert!(camera.forward.dot(camera.up).abs() < 1e-3 && camera.forward.dot(camera.right).abs() < 1e-3);
        assert!(camera.vertical_fov > 0.0 && camera.vertical_fov < std::f32::consts::PI);
    }
    for note in &scene.notes {
        assert!(!note.contains('\n'), "a note is one line: {note}");
    }
}

/// The scene in words: equal only for scenes equal to the bit.
pub(crate) fn bits(scene: &Scene) -> String {
    format!("{scene:?}")
}
