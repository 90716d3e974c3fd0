//! The same bits for any number of threads. (Without feature `parallel` there is one either way.)

mod common;

use common::{baked_room, finish, params, solid};

#[test]
fn one_thread_and_three() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mut world, mut baker, mut receivers) = baked_room(params(0.05));
            world.put(&mut baker, 1, Some(solid([2.0, 0.0, -3.0], [3.0, 2.0, -2.0], 0.5)));
            finish(&mut baker, &world, &mut receivers);
            (baker.save(1), receivers.sums)
        })
    };
    assert!(run(1) == run(3));
}
