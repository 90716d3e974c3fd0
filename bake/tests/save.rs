//! A bake that was saved and taken up again goes on as if nothing had happened.

mod common;

use bake::{BakeParams, Baker, Light, LightKey, LoadError, StepBudget};
use common::{Receivers, World, baked_room, bulb, finish, lamp, params, room, solid};
use glam::Vec3;

const SCENE: u64 = 0x1234;

fn reload(baker: &Baker) -> Baker {
    Baker::load(&baker.save(SCENE), SCENE, *baker.params()).unwrap()
}

#[test]
fn a_finished_bake_stays_finished() {
    let (world, baker, mut receivers) = baked_room(params(0.05));
    let start = receivers.clone();
    let mut again = reload(&baker);
    assert_eq!(again.contributions().count(), baker.contributions().count());
    finish(&mut again, &world, &mut receivers);
    assert_eq!(receivers, start, "nothing was accumulated");
    assert_eq!(again.save(SCENE).len(), baker.save(SCENE).len());
}

/// Edits and steps, with a kill and a resumption after each; the end is as without.
#[test]
fn killed_at_any_moment() {
    let run = |kill: bool| {
        let mut world = room();
        let mut baker = Baker::new(params(0.05)).unwrap();
        baker.add_light(LightKey(1), lamp([0.0, 3.9, 0.0], 100.0, 1000)).unwrap();
        baker.add_light(LightKey(7), bulb([-3.0, 3.0, 3.0], 40.0, 400)).unwrap();
        let mut receivers = Receivers::plane([-4.9, -4.9], [4.9, 4.9], 1e-3, 6);
        let budget = StepBudget { paths: 300, accumulations: 15 };
        for moment in 0..20u32 {
            match moment {
                6 => world.put(&mut baker, 1, Some(solid([2.0, 0.0, -3.0], [3.0, 2.0, -2.0], 0.5))),
                9 => world.recolour(&mut baker, 2, Vec3::new(0.9, 0.1, 0.1)),
                12 => baker.remove_light(LightKey(7)).unwrap(),
                15 => baker.set_light(LightKey(1), lamp([1.0, 3.9, 1.0], 60.0, 1000)).unwrap(),
                _ => {}
            }
            for _ in 0..2 + 3 * (moment % 3) {
                baker.step(budget, &world.trace(), &mut |update| receivers.apply(&world, update));
            }
            if kill {
                baker = reload(&baker);
            }
        }
        finish(&mut baker, &world, &mut receivers);
        receivers.sums
    };
    assert_eq!(run(true), run(false));
}

/// Light of a lamp that was taken out, still in the map when the bake is killed, is taken away after it.
#[test]
fn what_is_no_more_is_not_forgotten() {
    let (world, mut baker, receivers) = baked_room(params(0.05));
    baker.remove_light(LightKey(7)).unwrap();
    let ends = [reload(&baker), baker].map(|mut baker| {
        let mut receivers = receivers.clone();
        finish(&mut baker, &world, &mut receivers);
        receivers.sums
    });
    assert!(ends[0] == ends[1] && ends[0] != receivers.sums);
}

#[test]
fn every_kind_of_light_is_read_as_it_was_written() {
    use bake::{Aperture, IntensityTable, Profile};
    let table =
        IntensityTable::new(vec![0.0, 90.0, 360.0], vec![0.0, 90.0], vec![3.0, 1.0, 2.0, 0.0, 3.0, 1.0])
            .unwrap();
    let apertures = [
        Aperture::Point,
        Aperture::Sphere { radius: 0.2 },
        Aperture::Disk { radius: 0.3 },
        Aperture::polygon(&[Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Z], true),
        Aperture::Sky { half_angle: 0.3 },
    ];
    let profiles =
        [Profile::Lambert, Profile::Spot { cos_inner: 0.9, cos_outer: 0.3 }, Profile::Table(table.into())];
    let world = World::new(vec![Some(room().solids()[1].unwrap())].into_iter().flatten().collect());
    let mut baker = Baker::new(params(0.5)).unwrap();
    for (i, aperture) in apertures.iter().enumerate() {
        for (j, profile) in profiles.iter().enumerate() {
            let light = Light {
                aperture: aperture.clone(),
                profile: profile.clone(),
                ..lamp([0.0, 3.0, 0.0], 5.0, 50)
            };
            baker.add_light(LightKey((10 * i + j) as u32), light).unwrap();
        }
    }
    let mut receivers = Receivers::plane([-4.9, -4.9], [4.9, 4.9], 1e-3, 3);
    finish(&mut baker, &world, &mut receivers);
    let start = receivers.clone();
    let mut again = reload(&baker);
    for key in baker.light_keys() {
        assert_eq!(again.light(key), baker.light(key));
    }
    finish(&mut again, &world, &mut receivers);
    assert_eq!(receivers, start);
}

#[test]
fn what_is_not_this_bake_is_refused() {
    let (_, baker, _) = baked_room(params(0.5));
    let bytes = baker.save(SCENE);
    let load = |bytes: &[u8], scene, params| Baker::load(bytes, scene, params).map(|_| ()).unwrap_err();
    assert_eq!(load(b"PNG", SCENE, *baker.params()), LoadError::NoBake);
    assert_eq!(load(&bytes, 1, *baker.params()), LoadError::OtherScene { found: SCENE, expected: 1 });
    let other = BakeParams { clusters: 61, ..*baker.params() };
    assert_eq!(load(&bytes, SCENE, other), LoadError::OtherDial { name: "clusters" });
    let mut newer = bytes.clone();
    newer[6] = 9;
    assert_eq!(load(&newer, SCENE, *baker.params()), LoadError::Format { found: 9, expected: Baker::FORMAT });
    // Any one byte that is gone or changed.
    for i in (8..bytes.len()).step_by(97) {
        assert!(Baker::load(&bytes[..i], SCENE, *baker.params()).is_err());
        let mut changed = bytes.clone();
        changed[i] ^= 0x20;
        assert!(Baker::load(&changed, SCENE, *baker.params()).is_err(), "byte {i}");
    }
}
