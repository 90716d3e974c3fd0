//! What the importer reads, feature by feature, on small files made by code; and the shared scenes' counts.

mod glb;
mod sound;

use std::path::PathBuf;
use std::time::Instant;

use glam::{Affine2, Vec2, Vec3};
use scene::{
    AlphaMode, ImportLimits, ImportOptions, Light, MaterialMode, Scene, SceneChoice, SceneError, Wrap, load,
    open,
};

use glb::{Asset, Folder, textured_triangle, triangle};

fn import_with(test: &str, asset: &Asset, options: &ImportOptions) -> Scene {
    let folder = Folder::new(test);
    let scene =
        load(&folder.write("scene.glb", &asset.glb()), options).unwrap_or_else(|error| panic!("{error}"));
    sound::assert_sound(&scene);
    scene
}

fn import(test: &str, asset: &Asset) -> Scene {
    import_with(test, asset, &ImportOptions::default())
}

fn has_note(scene: &Scene, part: &str) -> bool {
    scene.notes.iter().any(|note| note.contains(part))
}

fn assert_near(a: Vec3, b: Vec3) {
    assert!((a - b).abs().max_element() < 1e-5, "{a} and {b}");
}

/// World-space normal of an instance's first triangle, by its winding.
fn world_normal(scene: &Scene, instance: usize) -> Vec3 {
    let instance = scene.instances[instance];
    let mesh = &scene.meshes[instance.mesh as usize];
    let [a, b, c] = mesh.triangles[0].map(|i| instance.to_world.transform_point3(mesh.positions[i as usize]));
    (b - a).cross(c - a).normalize()
}

#[test]
fn lists_strips_and_fans_with_and_without_indices() {
    let mut asset = Asset::default();
    let p =
        asset.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 0.0]]);
    let i = asset.indices(&[0, 1, 2, 3, 4]);
    let primitives = [
        format!(r#"{{"attributes":{{"POSITION":{p}}},"indices":{i},"mode":5}}"#),
        format!(r#"{{"attributes":{{"POSITION":{p}}},"mode":5}}"#),
        format!(r#"{{"attributes":{{"POSITION":{p}}},"mode":6}}"#),
        format!(r#"{{"attributes":{{"POSITION":{p}}}}}"#),
        format!(r#"{{"attributes":{{"POSITION":{p}}},"mode":0}}"#),
        format!(r#"{{"attributes":{{"POSITION":{p}}},"mode":3}}"#),
    ];
    asset.set("meshes", format!(r#"[{{"primitives":[{}]}}]"#, primitives.join(",")));
    asset.set("nodes", r#"[{"mesh":0}]"#).set("scenes", r#"[{"nodes":[0]}]"#);
    let scene = import("modes", &asset);
    let triangles: Vec<&[[u32; 3]]> = scene.meshes.iter().map(|mesh| &mesh.triangles[..]).collect();
    let strip: &[[u32; 3]] = &[[0, 1, 2], [2, 1, 3], [2, 3, 4]];
    let fan: &[[u32; 3]] = &[[0, 1, 2], [0, 2, 3], [0, 3, 4]];
    assert_eq!(triangles, [strip, strip, fan, &[[0, 1, 2]]]);
    assert!(has_note(&scene, "points or lines are left out (2 times)"), "{:?}", scene.notes);
    assert!(has_note(&scene, "2 indices after the last whole triangle"), "{:?}", scene.notes);
}

#[test]
fn indices_of_8_and_32_bits() {
    for (kind, bytes) in
        [(5121, vec![2_u8, 1, 0]), (5125, [2_u32, 1, 0].iter().flat_map(|i| i.to_le_bytes()).collect())]
    {
        let mut asset = triangle("{}");
        let view = asset.view(&bytes, "");
        let i = asset
            .accessor(format!(r#"{{"bufferView":{view},"componentType":{kind},"count":3,"type":"SCALAR"}}"#));
        asset.set(
            "meshes",
            format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":{i}}}]}}]"#),
        );
        assert_eq!(import("index-types", &asset).meshes[0].triangles, [[2, 1, 0]]);
    }
}

#[test]
fn transforms_multiply_along_the_hierarchy_and_instances_share_their_mesh() {
    let mut asset = triangle("{}");
    asset.set(
        "nodes",
        r#"[{"matrix":[2,0,0,0, 0,2,0,0, 0,0,2,0, 1,2,3,1],"children":[1,2],"mesh":0},
            {"translation":[10,0,0],"rotation":[0,0,0.70710678,0.70710678],"scale":[3,1,1],"mesh":0},
            {"scale":[0,1,1],"mesh":0,"name":"flat"}]"#,
    );
    let scene = import("transforms", &asset);
    assert_eq!((scene.meshes.len(), scene.instances.len(), scene.triangle_count()), (1, 2, 2));
    assert_near(scene.instances[0].to_world.transform_point3(Vec3::ONE), Vec3::new(3.0, 4.0, 5.0));
    // x is stretched by 3, turned to y, moved by 10, doubled, moved.
    assert_near(scene.instances[1].to_world.transform_point3(Vec3::X), Vec3::new(21.0, 8.0, 3.0));
    assert!(
        has_note(&scene, "node 2 \"flat\": left out, since its transform is singular"),
        "{:?}",
        scene.notes
    );
}

#[test]
fn scenes_are_chosen() {
    let mut asset = triangle("{}");
    asset.set("nodes", r#"[{"mesh":0},{"mesh":0},{"mesh":0}]"#);
    asset.set("scenes", r#"[{"nodes":[0]},{"nodes":[1,2]}]"#).set("scene", "1");
    assert_eq!(import("default-scene", &asset).instances.len(), 2);
    let all = ImportOptions { scene: SceneChoice::All, ..ImportOptions::default() };
    assert_eq!(import_with("all-scenes", &asset, &all).instances.len(), 3);
}

#[test]
fn emissive_triangles_are_lights_and_mirrored_ones_keep_their_side() {
    let material = r#"{"emissiveFactor":[1,0.5,0.25],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":8}}}"#;
    let mut asset = triangle(material);
    asset
        .set("nodes", r#"[{"mesh":0},{"mesh":0,"scale":[-1,1,1],"translation":[0,0,5]}]"#)
        .set("scenes", r#"[{"nodes":[0,1]}]"#);
    let scene = import("emissive", &asset);
    assert_eq!(scene.lights.len(), 2);
    assert!(!scene.instances[0].is_mirrored() && scene.instances[1].is_mirrored());
    for (i, light) in scene.lights.iter().enumerate() {
        let Light::Triangle { vertices: [a, b, c], radiance, two_sided, instance, triangle } = *light else {
            panic!("{light:?}")
        };
        assert_eq!((radiance, two_sided, instance, triangle), (Vec3::new(8.0, 4.0, 2.0), false, i as u32, 0));
        // The object-space front is +z; mirroring in x leaves it there, though the winding turns round.
        assert_near((b - a).cross(c - a).normalize(), Vec3::Z);
    }
    assert_near(world_normal(&scene, 1), Vec3::NEG_Z);
    assert!(has_note(&scene, "2 of 2 emissive triangles are lights"), "{:?}", scene.notes);
}

#[test]
fn an_emitter_grows_with_its_area_whatever_the_transform() {
    let mut asset = triangle(r#"{"emissiveFactor":[1,1,1]}"#);
    let scales = [[1e-3, 1e-3, 1e-3], [1e3, 1e3, 1e3], [2.0, 5.0, 1.0], [-3.0, 1.0, 1.0], [1.0, 1.0, 1.0]];
    let node = |[x, y, z]: [f32; 3]| format!(r#"{{"mesh":0,"scale":[{x},{y},{z}]}}"#);
    asset.set("nodes", format!("[{}]", scales.map(node).join(",")));
    asset.set("scenes", r#"[{"nodes":[0,1,2,3,4]}]"#);
    let scene = import("emissive-scales", &asset);
    let intensity = |i: usize| lighttree::Emitter::bounds(&scene.lights[i]).intensity;
    for (i, [x, y, _]) in scales.iter().enumerate() {
        // The triangle lies in the plane of x and y.
        let expected = (x * y).abs() * intensity(4);
        assert!((intensity(i) - expected).abs() < 1e-5 * expected, "{} instead of {expected}", intensity(i));
    }
}

#[test]
fn an_emissive_texture_gives_its_mean_and_black_gives_no_light() {
    let material = r#"{"emissiveFactor":[1,1,1],"emissiveTexture":{"index":0}}"#;
    let white_and_red = [[255, 255, 255, 255], [255, 0, 0, 255]];
    let scene = import("emissive-texture", &textured_triangle(material, 1, &white_and_red));
    let Light::Triangle { radiance, .. } = scene.lights[0] else { panic!() };
    assert!((radiance.x - 1.0).abs() < 1e-6 && radiance.y > 0.5 && radiance.y < 1.0, "{radiance}");
    let black = import("emissive-black", &textured_triangle(material, 1, &[[0, 0, 0, 255]]));
    assert!(black.lights.is_empty());
    assert!(has_note(&black, "0 of 1 emissive triangles are lights (1 black"), "{:?}", black.notes);
}

const FULL_MATERIAL: &str = r#"{
    "name":"full","alphaMode":"MASK","alphaCutoff":0.25,"doubleSided":true,
    "pbrMetallicRoughness":{"baseColorFactor":[0.1,0.2,0.3,0.4],"metallicFactor":0.5,"roughnessFactor":0.6,
        "baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":{"offset":[0.5,0.25],"rotation":1.5707964,"scale":[2,3]}}},
        "metallicRoughnessTexture":{"index":1,"texCoord":1}},
    "extensions":{"KHR_materials_ior":{"ior":1.33},"KHR_materials_transmission":{"transmissionFactor":0.7},
        "KHR_materials_volume":{"thicknessFactor":0.1},
        "KHR_materials_specular":{"specularFactor":0.8,"specularColorFactor":[0.9,0.8,0.7]}}}"#;

fn full_material() -> Asset {
    let mut asset = textured_triangle(FULL_MATERIAL, 1, &[[1, 2, 3, 4]]);
    asset.set("samplers", r#"[{"wrapS":33071,"wrapT":33648},{}]"#);
    asset.set("textures", r#"[{"source":0,"sampler":0},{"source":0}]"#);
    asset
}

#[test]
fn materials_with_their_extensions_and_textures() {
    let scene = import("material", &full_material());
    let material = &scene.materials[0];
    assert_eq!(material.name, "full");
    assert_eq!((material.base_color, material.alpha), (Vec3::new(0.1, 0.2, 0.3), 0.4));
    assert_eq!((material.metallic, material.roughness), (0.5, 0.6));
    assert_eq!((material.alpha_mode, material.double_sided), (AlphaMode::Mask(0.25), true));
    assert_eq!((material.ior, material.specular, material.transmission), (1.33, 0.8, 0.7));
    assert_eq!((material.specular_color, material.thin), (Vec3::new(0.9, 0.8, 0.7), false));
    let (color, rough) = (material.base_color_texture.unwrap(), material.metallic_roughness_texture.unwrap());
    assert_eq!((color.uv_set, rough.uv_set, rough.transform), (0, 1, Affine2::IDENTITY));
    let [color, rough] = [color, rough].map(|slot| (slot, &scene.textures[slot.texture as usize]));
    assert_eq!((color.1.wrap, color.1.srgb), ([Wrap::Clamp, Wrap::Mirror], true));
    assert_eq!((rough.1.wrap, rough.1.srgb), ([Wrap::Repeat, Wrap::Repeat], false));
    assert_eq!(color.1.texels, [[1, 2, 3, 4]]);
    // Scaled, then turned counter-clockwise on the image, whose v points down: u goes up.
    let at = color.0.transform.transform_point2(Vec2::X);
    assert!((at - Vec2::new(0.5, 0.25 - 2.0)).length() < 1e-5, "{at}");
    assert!(has_note(&scene, "no texture coordinates"), "TEXCOORD_1 is missing: {:?}", scene.notes);
}

#[test]
fn defaults_are_those_of_gltf() {
    let scene = import("defaults", &triangle("{}"));
    let material = &scene.materials[0];
    assert_eq!((material.base_color, material.alpha), (Vec3::ONE, 1.0));
    assert_eq!(
        (material.metallic, material.roughness, material.specular, material.ior),
        (1.0, 1.0, 1.0, 1.5)
    );
    assert!(!material.double_sided && material.thin && material.emissive == Vec3::ZERO);
    assert!(scene.meshes[0].normals.is_empty() && scene.meshes[0].uvs.len() == 3);
}

#[test]
fn diffuse_and_phong_modes_flatten_materials_and_leave_see_through_ones_out() {
    let diffuse = ImportOptions { materials: MaterialMode::Diffuse, ..ImportOptions::default() };
    let phong = ImportOptions { materials: MaterialMode::Phong(150.0), ..ImportOptions::default() };
    let material = |alpha: f32, mode: &str, transmission: f32| {
        format!(
            r#"{{"alphaMode":"{mode}","pbrMetallicRoughness":{{"baseColorFactor":[0.1,0.2,0.3,{alpha}]}},"emissiveFactor":[1,1,1],
            "extensions":{{"KHR_materials_transmission":{{"transmissionFactor":{transmission}}}}}}}"#
        )
    };
    for (alpha, mode, transmission, kept) in [
        (1.0, "OPAQUE", 0.0, true),
        (0.1, "OPAQUE", 0.0, true),
        (0.49, "BLEND", 0.0, false),
        (0.5, "BLEND", 0.0, true),
        (1.0, "OPAQUE", 0.5, true),
        (1.0, "OPAQUE", 0.51, false),
        (0.1, "MASK", 0.0, true),
    ] {
        let asset = triangle(&material(alpha, mode, transmission));
        for (options, exponent) in [(&diffuse, None), (&phong, Some(150.0))] {
            let scene = import_with("modes-of-material", &asset, options);
            assert_eq!(scene.triangle_count(), usize::from(kept), "{alpha} {mode} {transmission}");
            assert_eq!(scene.lights.len(), usize::from(kept), "what is left out emits nothing");
            assert_eq!(has_note(&scene, "see-through primitives are left out"), !kept);
            if kept {
                let material = &scene.materials[0];
                assert_eq!(material.base_color, Vec3::new(0.1, 0.2, 0.3));
                assert_eq!((material.metallic, material.specular, material.transmission), (0.0, 0.0, 0.0));
                assert_eq!(material.phong_exponent, exponent);
                assert_ne!(material.alpha_mode, AlphaMode::Blend);
                assert_eq!(mode == "MASK", material.alpha_mode == AlphaMode::Mask(0.5));
            }
        }
        let full = import("mode-gltf", &asset);
        assert_eq!(full.triangle_count(), 1, "glTF mode keeps everything");
        assert_eq!(full.materials[0].alpha_mode == AlphaMode::Blend, mode == "BLEND");
    }
    let metal = import_with("diffuse-textures", &full_material(), &diffuse);
    assert!(metal.materials.is_empty(), "transmission 0.7");
}

#[test]
fn punctual_lights_follow_their_nodes() {
    let mut asset = triangle("{}");
    asset.set(
        "extensions",
        r#"{"KHR_lights_punctual":{"lights":[
            {"type":"point","color":[1,0.5,0],"intensity":6,"range":3},
            {"type":"spot","intensity":2,"spot":{"innerConeAngle":0.2,"outerConeAngle":0.7}},
            {"type":"directional","intensity":3},
            {"type":"point","intensity":0}]}}"#,
    );
    // All under a node that turns -z to -y (and y to -z) and doubles.
    let light =
        |i| format!(r#"{{"translation":[1,2,3],"extensions":{{"KHR_lights_punctual":{{"light":{i}}}}}}}"#);
    let root = r#"{"children":[1,2,3,4],"rotation":[-0.70710678,0,0,0.70710678],"scale":[2,2,2]}"#;
    asset.set("nodes", format!("[{root},{}]", (0..4).map(light).collect::<Vec<_>>().join(",")));
    let scene = import("lights", &asset);
    let place = Vec3::new(2.0, 6.0, -4.0);
    let [Light::Point { position, intensity }, spot] = scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert_near(position, place);
    assert_eq!(intensity, Vec3::new(6.0, 3.0, 0.0));
    let Light::Spot { position, axis, intensity, cos_inner, cos_outer } = spot else { panic!("{spot:?}") };
    assert_near(position, place);
    assert_near(axis, Vec3::NEG_Y);
    assert_eq!((intensity, cos_inner, cos_outer), (Vec3::splat(2.0), 0.2_f32.cos(), 0.7_f32.cos()));
    assert_near(scene.distant[0].direction, Vec3::NEG_Y);
    assert_eq!(scene.distant[0].irradiance, Vec3::splat(3.0));
    assert!(has_note(&scene, "zero intensity are left out (1 times)"), "{:?}", scene.notes);
}

#[test]
fn cameras_look_along_minus_z() {
    let mut asset = triangle("{}");
    asset.set(
        "cameras",
        r#"[{"type":"perspective","perspective":{"yfov":0.8,"znear":0.1}},
            {"type":"orthographic","orthographic":{"xmag":1,"ymag":1,"zfar":9,"znear":0.1}}]"#,
    );
    asset.set("nodes", r#"[{"camera":0,"name":"main","translation":[1,2,3],"rotation":[0,0.70710678,0,0.70710678]},{"camera":1}]"#);
    asset.set("scenes", r#"[{"nodes":[0,1]}]"#);
    let scene = import("cameras", &asset);
    let [camera] = &scene.cameras[..] else { panic!("{:?}", scene.cameras) };
    assert_eq!((camera.name.as_str(), camera.vertical_fov), ("main", 0.8));
    assert_near(camera.position, Vec3::new(1.0, 2.0, 3.0));
    assert_near(camera.forward, Vec3::NEG_X);
    assert_near(camera.right, Vec3::NEG_Z);
    assert_near(camera.up, Vec3::Y);
    assert!(has_note(&scene, "orthographic"), "{:?}", scene.notes);
}

#[test]
fn normals_are_normalised_and_missing_directions_come_from_the_faces() {
    let mut asset = triangle("{}");
    let n = asset.floats(&[[0.0, 0.0, 1e-30], [3e38, 0.0, 3e38], [0.0, 0.0, 0.0]]);
    asset.set(
        "meshes",
        format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":{n}}},"indices":2}}]}}]"#),
    );
    let scene = import("normals", &asset);
    let normals = &scene.meshes[0].normals;
    assert_near(normals[0], Vec3::Z);
    assert_near(normals[1], Vec3::new(0.5_f32.sqrt(), 0.0, 0.5_f32.sqrt()));
    assert_near(normals[2], Vec3::Z);
    assert!(has_note(&scene, "1 normals without direction"), "{:?}", scene.notes);
}

#[test]
fn sparse_accessors_with_and_without_a_base() {
    let mut asset = triangle("{}");
    let indices = asset.view(&[1, 0, 2, 0], "");
    let bytes: Vec<u8> = [7.0_f32, 8.0, 9.0, 4.0, 5.0, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = asset.view(&bytes, "");
    let sparse = format!(
        r#""sparse":{{"count":2,"indices":{{"bufferView":{indices},"componentType":5123}},"values":{{"bufferView":{values}}}}}"#
    );
    let common = r#""componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[9,9,9]"#;
    for (base, first) in [(r#""bufferView":0,"#, Vec3::ZERO), ("", Vec3::ZERO)] {
        let mut asset = asset.clone();
        let p = asset.accessor(format!("{{{base}{common},{sparse}}}"));
        asset.set("meshes", format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":{p}}}}}]}}]"#));
        let positions = import("sparse", &asset).meshes[0].positions.clone();
        assert_eq!(positions, [first, Vec3::new(7.0, 8.0, 9.0), Vec3::new(4.0, 5.0, 6.0)]);
    }
}

#[test]
fn strided_views_and_normalized_texture_coordinates() {
    let mut asset = triangle("{}");
    let rows: Vec<u8> = (0..3_u8).flat_map(|i| [i * 51, 255, 0, 0]).collect();
    let view = asset.view(&rows, r#","byteStride":4"#);
    let uv = asset.accessor(format!(
        r#"{{"bufferView":{view},"componentType":5121,"normalized":true,"count":3,"type":"VEC2"}}"#
    ));
    asset.set(
        "meshes",
        format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":{uv}}}}}]}}]"#),
    );
    let uvs = import("strided", &asset).meshes[0].uvs.clone();
    assert_eq!(uvs, [Vec2::new(0.0, 1.0), Vec2::new(0.2, 1.0), Vec2::new(0.4, 1.0)]);
}

#[test]
fn primitives_that_share_a_large_array_keep_what_they_use() {
    let mut asset = triangle("{}");
    let many: Vec<[f32; 3]> = (0..1000).map(|i| [i as f32, (i * i) as f32, 0.0]).collect();
    let p = asset.floats(&many);
    let i = asset.indices(&[900, 17, 500]);
    asset.set("meshes", format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":{p}}},"indices":{i}}}]}}]"#));
    let scene = import("shared-array", &asset);
    assert_eq!(scene.meshes[0].triangles, [[0, 1, 2]]);
    let x: Vec<f32> = scene.meshes[0].positions.iter().map(|p| p.x).collect();
    assert_eq!(x, [900.0, 17.0, 500.0]);
}

#[test]
fn files_beside_the_scene_data_uris_and_what_is_refused() {
    let asset = triangle(r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#);
    let folder = Folder::new("external");
    folder.write("parts/my buffer.bin", &asset.bin);
    folder.write("parts/a.jpg", &glb::jpeg(5, 3));
    folder.write("outside.bin", &asset.bin);
    let gltf = |name: &str, buffer: &str, image: &str| {
        let mut asset = asset.clone();
        asset.set("images", format!(r#"[{{"uri":"{image}"}}]"#)).set("textures", r#"[{"source":0}]"#);
        let buffer = format!(r#"{{"byteLength":{},"uri":"{buffer}"}}"#, asset.bin.len());
        load(&folder.write(name, asset.json_with_buffer(&buffer).as_bytes()), &ImportOptions::default())
    };
    let scene = gltf("a.gltf", "parts/my%20buffer.bin", "parts/a.jpg").unwrap();
    sound::assert_sound(&scene);
    assert_eq!((scene.triangle_count(), scene.textures[0].width, scene.name.as_str()), (1, 5, "a.gltf"));
    // One texel of PNG.
    let png = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
    let data = gltf("data.gltf", "parts/my%20buffer.bin", png).unwrap();
    assert_eq!((data.textures[0].width, data.textures[0].texels.len()), (1, 1));
    for uri in [
        "../outside.bin",
        "/etc/passwd",
        "file:///etc/passwd",
        "https://example.org/a.bin",
        "..\\\\outside.bin",
        "a/../../x",
        "",
    ] {
        let error = gltf("parts/inner.gltf", uri, png).unwrap_err().to_string();
        assert!(error.contains("buffer 0") && error.contains("relative path"), "{uri}: {error}");
    }
    let error = gltf("a.gltf", "parts/none.bin", png).unwrap_err().to_string();
    assert!(error.contains("buffer 0") && error.contains("none.bin"), "{error}");
    assert!(gltf("a.gltf", "parts", png).unwrap_err().to_string().contains("not a plain file"));
}

#[cfg(unix)]
#[test]
fn a_symbolic_link_does_not_lead_out_of_the_folder() {
    let asset = triangle("{}");
    let folder = Folder::new("symlink");
    let secret = folder.write("secret.bin", &asset.bin);
    let json = asset.json_with_buffer(&format!(r#"{{"byteLength":{},"uri":"link.bin"}}"#, asset.bin.len()));
    let path = folder.write("inside/scene.gltf", json.as_bytes());
    std::os::unix::fs::symlink(&secret, path.with_file_name("link.bin")).unwrap();
    let error = load(&path, &ImportOptions::default()).unwrap_err().to_string();
    assert!(error.contains("leads out of the scene's folder"), "{error}");
}

#[test]
fn every_limit_is_checked_and_named() {
    let mut asset =
        textured_triangle(r#"{"emissiveFactor":[1,1,1],"emissiveTexture":{"index":0}}"#, 2, &[[9; 4]; 8]);
    asset.set("nodes", r#"[{"children":[1]},{"mesh":0,"children":[2]},{"mesh":0}]"#);
    let folder = Folder::new("limits");
    let path = folder.write("scene.glb", &asset.glb());
    let roomy = ImportLimits::default();
    let tight = [
        ("max_bytes", ImportLimits { max_bytes: 100, ..roomy }),
        ("max_json_bytes", ImportLimits { max_json_bytes: 100, ..roomy }),
        ("max_json_structures", ImportLimits { max_json_structures: 5, ..roomy }),
        ("max_accessor_elements", ImportLimits { max_accessor_elements: 8, ..roomy }),
        ("max_texture_pixels", ImportLimits { max_texture_pixels: 7, ..roomy }),
        ("max_instances", ImportLimits { max_instances: 1, ..roomy }),
        ("max_triangles", ImportLimits { max_triangles: 1, ..roomy }),
        ("max_emissive_triangles", ImportLimits { max_emissive_triangles: 1, ..roomy }),
        ("max_node_depth", ImportLimits { max_node_depth: 2, ..roomy }),
    ];
    assert!(load(&path, &ImportOptions::default()).is_ok());
    for (parameter, limits) in tight {
        let error =
            load(&path, &ImportOptions { limits, ..ImportOptions::default() }).unwrap_err().to_string();
        assert!(error.contains(&format!("raise ImportLimits::{parameter}")), "{parameter}: {error}");
    }
}

#[test]
fn a_name_or_a_path_opens_a_scene_and_a_typo_lists_the_names() {
    let options = ImportOptions::default();
    assert_eq!(open("hall:3", &options).unwrap().lights.len(), 3);
    let message = |spec: &str| open(spec, &options).unwrap_err().to_string();
    for typo in ["halle", "hal:3", "cornel"] {
        assert!(message(typo).contains("hall:10000, cornell"), "{}", message(typo));
    }
    assert!(matches!(open("none.glb", &options).unwrap_err(), SceneError::Import(_)));
    assert!(message("none.glb").starts_with("none.glb: cannot be read"));
    let folder = Folder::new("open");
    let path = folder.write("scene.glb", &triangle("{}").glb());
    assert_eq!(open(path.to_str().unwrap(), &options).unwrap().triangle_count(), 1);
}

#[test]
fn the_framing_camera_sees_the_whole_scene() {
    for spec in ["cornell", "hall:1", "city:1"] {
        let scene = open(spec, &ImportOptions::default()).unwrap();
        let camera = scene.framing_camera();
        let (min, max) = scene.bounds().unwrap();
        let half = (0.5 * camera.vertical_fov).tan();
        for i in 0..8 {
            let corner = Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), min, max);
            let seen = corner - camera.position;
            let depth = seen.dot(camera.forward);
            assert!(depth > 0.0 && seen.dot(camera.up).abs() <= half * depth, "{spec}: {corner}");
            assert!(seen.dot(camera.right).abs() <= half * depth, "{spec}: {corner}");
        }
    }
    assert!(Scene::default().framing_camera().position.is_finite());
}

/// The folder of shared scenes; `None`, said on stderr, where there is none.
fn shared(file: &str) -> Option<PathBuf> {
    let folder = match std::env::var_os("LIGHTTREE_SCENES") {
        Some(folder) => PathBuf::from(folder),
        None => PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
    };
    let path = folder.join(file);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: no {}; set LIGHTTREE_SCENES to the folder of shared scenes", path.display());
    None
}

fn load_shared(file: &str) -> Option<Scene> {
    let path = shared(file)?;
    let start = Instant::now();
    let scene = load(&path, &ImportOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    eprintln!(
        "{file}: {:.3} s, {} triangles, {} lights",
        start.elapsed().as_secs_f64(),
        scene.triangle_count(),
        scene.lights.len()
    );
    for note in &scene.notes {
        eprintln!("  {note}");
    }
    sound::assert_sound(&scene);
    Some(scene)
}

#[test]
fn shared_scenes_have_the_counts_that_their_readme_says() {
    // file, triangles, emissive triangles, of which black under their texture, punctual lights, directional,
    // cameras
    let table = [
        ("cornell-box.glb", 38, 2, 0, 0, 0, 1),
        ("sponza.glb", 66_449, 4, 0, 0, 0, 3),
        ("sponza-lanterns.glb", 93_565, 27_120, 0, 0, 0, 3),
        ("living-room.glb", 400_379, 8, 0, 0, 0, 1),
        ("kitchen.glb", 1_050_722, 8, 0, 0, 0, 1),
        ("classroom.glb", 103_860, 30, 0, 0, 1, 1),
        ("dragon.glb", 206_570, 3_846, 0, 0, 0, 2),
        ("town-night.glb", 384_964, 3_296, 632, 72, 1, 3),
        ("labyrinth.glb", 157_858, 0, 0, 194, 0, 3),
        ("flight-helmet/FlightHelmet.gltf", 94_722, 0, 0, 0, 0, 0),
        ("mixed-lighting/MixedLightingExample.gltf", 40_898, 0, 0, 0, 1, 0),
    ];
    for (file, triangles, emissive, black, punctual, distant, cameras) in table {
        let Some(scene) = load_shared(file) else { continue };
        let area = scene.lights.iter().filter(|light| matches!(light, Light::Triangle { .. })).count();
        assert_eq!(scene.triangle_count(), triangles, "{file}");
        assert_eq!(area, emissive - black, "{file}");
        assert_eq!(scene.lights.len() - area, punctual, "{file}");
        assert_eq!(scene.distant.len(), distant, "{file}");
        assert_eq!(scene.cameras.len(), cameras, "{file}");
        let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
        eprintln!("  cameras {names:?}");
    }
}

/// The built-in box and the file of the same published data are the same box.
#[test]
fn the_built_in_cornell_box_is_the_file() {
    let Some(file) = load_shared("cornell-box.glb") else { return };
    let builtin = scene::builtin("cornell").unwrap();
    let corners = |scene: &Scene| -> Vec<Vec3> {
        let triangles = scene.instances.iter().flat_map(|instance| {
            let mesh = &scene.meshes[instance.mesh as usize];
            let world = |i: &u32| instance.to_world.transform_point3(mesh.positions[*i as usize]);
            mesh.triangles.iter().flatten().map(world).collect::<Vec<_>>()
        });
        triangles.collect()
    };
    let (ours, theirs) = (corners(&builtin), corners(&file));
    let apart =
        |p: &Vec3, others: &[Vec3]| others.iter().map(|q| p.distance(*q)).fold(f32::INFINITY, f32::min);
    for (a, b) in [(&ours, &theirs), (&theirs, &ours)] {
        let farthest = a.iter().map(|p| apart(p, b)).fold(0.0, f32::max);
        assert!(farthest < 1e-5, "a corner is {farthest} m away");
    }
    assert_eq!(builtin.lights.len(), file.lights.len());
    let camera = &builtin.cameras[0];
    assert!(camera.position.distance(file.cameras[0].position) < 1e-5);
    assert!((camera.vertical_fov - file.cameras[0].vertical_fov).abs() < 1e-3);
}
