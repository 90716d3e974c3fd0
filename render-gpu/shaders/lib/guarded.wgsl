// Twin of stochastic/src/guarded.rs: whether the cut that was made for another receiver will do. Asks the receivers for their lobes.

fn is_admitted(representative: Receiver, own: Receiver) -> bool {
    let a = receiver_position(representative);
    let b = receiver_position(own);
    let normal_a = receiver_lobes(representative).normal;
    let normal_b = receiver_lobes(own).normal;
    let apart = b - a;
    let depth = min(length(a - params.eye), length(b - params.eye));
    let off_plane = max(abs(dot(apart, normal_a)), abs(dot(apart, normal_b)));
    return dot(normal_a, normal_b) >= params.min_normal_cos && off_plane <= params.max_plane_distance * depth
        && length(apart) <= params.max_distance * depth;
}
