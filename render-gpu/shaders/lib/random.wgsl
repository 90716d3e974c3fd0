// Twin of lighttree/src/rng.rs: the same bits. There everything is explained.

// Four well mixed words from four counters: Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020.
fn pcg4d(key: vec4u) -> vec4u {
    var v = key * 1664525u + 1013904223u;
    v = pcg_mix(v);
    v ^= v >> vec4u(16u);
    return pcg_mix(v);
}

fn pcg_mix(words: vec4u) -> vec4u {
    var v = words;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

struct Random {
    // Seed, stream, index, and the number of the next word.
    key: vec4u,
    words: vec4u,
}

fn random_new(seed: u32, stream: u32, index: u32) -> Random {
    return Random(vec4u(seed, stream, index, 0u), vec4u(0u));
}

fn random_u32(random: ptr<function, Random>) -> u32 {
    let key = (*random).key;
    let lane = key.w % 4u;
    if (lane == 0u) {
        (*random).words = pcg4d(vec4u(key.xyz, key.w / 4u));
    }
    (*random).key.w = key.w + 1u;
    return (*random).words[lane];
}

fn random_u64(random: ptr<function, Random>) -> vec2u {
    let high = random_u32(random);
    return vec2u(high, random_u32(random));
}

// A uniform number among 0..=last that is consumed choice by choice and never runs out.
struct Decisions {
    value: vec2u,
    last: vec2u,
    fresh: Random,
}

fn decisions_new(stream: Random) -> Decisions {
    var fresh = stream;
    let value = random_u64(&fresh);
    return Decisions(value, WIDE_MAX, fresh);
}

fn decisions_restart(decisions: ptr<function, Decisions>, first: vec2u) {
    (*decisions).value = first;
    (*decisions).last = WIDE_MAX;
}

fn decisions_stream_u64(decisions: ptr<function, Decisions>) -> vec2u {
    var fresh = (*decisions).fresh;
    let word = random_u64(&fresh);
    (*decisions).fresh = fresh;
    return word;
}

// True with probability `first` / 2^32.
fn choose(decisions: ptr<function, Decisions>, first: u32) -> bool {
    var value = (*decisions).value;
    var last = (*decisions).last;
    var fresh = (*decisions).fresh;
    // (last + 1) · first in three words: `whole` and `part`.
    let low = wide_add(wide_product(last.y, first), vec2u(0u, first));
    let whole = wide_add(wide_product(last.x, first), vec2u(0u, low.x));
    let part = low.y;
    var chosen = false;
    if (wide_less(value, whole)) {
        last = wide_sub(whole, vec2u(0u, 1u));
        chosen = true;
    } else if (wide_less(whole, value)) {
        let beyond = wide_add(whole, vec2u(0u, 1u));
        value = wide_sub(value, beyond);
        last = wide_sub(last, beyond);
    } else {
        chosen = random_u32(&fresh) < part;
        value = random_u64(&fresh);
        last = WIDE_MAX;
    }
    if (last.x == 0u) {
        value = vec2u(value.y, random_u32(&fresh));
        last = vec2u(last.y, 0xffffffffu);
    }
    *decisions = Decisions(value, last, fresh);
    return chosen;
}

// A probability in 2^-32s, at least `floor` and as far from certain.
fn quantized(probability: f32, floor: u32) -> u32 {
    if (!(probability > 0.0)) {
        return floor;
    }
    return clamp(u32(min(probability, 0.99999994) * 4294967296.0), floor, 0xffffffffu - (floor - 1u));
}

// What a number of 2^-32s stands for.
fn probability_of(quantized: u32) -> f32 {
    return f32(quantized) * (1.0 / 4294967296.0);
}

// A product of probabilities: `value` · 2^(-40 · `scale`), so that it does not vanish on the way down a deep
// tree.
struct Probability {
    value: f32,
    scale: i32,
}

fn probability_times(p: Probability, q: f32) -> Probability {
    let product = p.value * q;
    if (product < 9.094947e-13) {
        return Probability(product * 1.0995116e12, p.scale + 1);
    }
    return Probability(product, p.scale);
}

// 1 ÷ (probability · count).
fn probability_weight(p: Probability, count: f32) -> f32 {
    var weight = 1.0 / (p.value * count);
    for (var i = 0; i < p.scale; i++) {
        weight *= 1.0995116e12;
    }
    return weight;
}
