// What was learned of a node: samples drawn, and the sum of their squared ratios. Twin of `halved` in stochastic/src/visibility.rs.

// A node that has so many samples keeps half of what is known of it: from there on it forgets by and by.
// 2^24 would be the last number that f32 can count on from.
const MOST_SAMPLES: f32 = 65536.0;

// Half of both, as often as there are too many samples.
fn halved(told: vec2f) -> vec2f {
    var less = told;
    while (less.x >= MOST_SAMPLES) {
        less *= 0.5;
    }
    return less;
}
