// The receiver of this crate: `ReceiverRecord` of src/receiver.rs. A host with records of its own writes a struct `Receiver` and these two functions
// instead.

struct Receiver {
    position: vec3f,
    diffuse: f32,
    normal: vec3f,
    peak: f32,
    axis: vec3f,
    width_squared: f32,
}

// World-space position.
fn receiver_position(receiver: Receiver) -> vec3f {
    return receiver.position;
}

// About how much of |f · cos θ| there is for light from the box, up to a factor that is the same for all
// boxes; 0 only where there is none.
fn receiver_scatter(receiver: Receiver, box: Toward) -> f32 {
    let cosine = toward_cos(box, receiver.normal);
    var scattered = receiver.diffuse * cosine;
    if (receiver.peak > 0.0 && cosine > 0.0) {
        scattered += receiver.peak * toward_lobe(box, receiver.normal, receiver.axis, receiver.width_squared);
    }
    return scattered;
}

// The same as lobes, for distributions over cuts.
fn receiver_lobes(receiver: Receiver) -> Lobes {
    return Lobes(receiver.normal, receiver.diffuse, receiver.axis, receiver.peak, receiver.width_squared);
}
