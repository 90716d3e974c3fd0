// Whole numbers of 64 bits as two words, the upper one first.

const WIDE_MAX = vec2u(0xffffffffu, 0xffffffffu);

fn wide_add(a: vec2u, b: vec2u) -> vec2u {
    let low = a.y + b.y;
    return vec2u(a.x + b.x + u32(low < a.y), low);
}

fn wide_sub(a: vec2u, b: vec2u) -> vec2u {
    return vec2u(a.x - b.x - u32(a.y < b.y), a.y - b.y);
}

fn wide_less(a: vec2u, b: vec2u) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

// The product of two words, all of it.
fn wide_product(a: u32, b: u32) -> vec2u {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & 0xffffu;
    let b_high = b >> 16u;
    let low = a_low * b_low;
    let cross = a_high * b_low + (low >> 16u);
    let other = a_low * b_high + (cross & 0xffffu);
    return vec2u(a_high * b_high + (cross >> 16u) + (other >> 16u), (other << 16u) | (low & 0xffffu));
}

// a · b mod 2^64.
fn wide_scale(a: vec2u, b: u32) -> vec2u {
    let low = wide_product(a.y, b);
    return vec2u(a.x * b + low.x, low.y);
}

// a / b, rounded down, for b below 2^16, and the remainder.
struct Quotient {
    quotient: vec2u,
    remainder: u32,
}

// (carry · 2^64 + a) / b, for carry < b < 2^16: long division in digits of 16 bits. The quotient fits,
// because of the carry.
fn wide_divide(carry: u32, a: vec2u, b: u32) -> Quotient {
    var digits = vec4u(a.x >> 16u, a.x & 0xffffu, a.y >> 16u, a.y & 0xffffu);
    var rest = carry;
    for (var i = 0u; i < 4u; i++) {
        let part = (rest << 16u) | digits[i];
        digits[i] = part / b;
        rest = part % b;
    }
    return Quotient(vec2u((digits.x << 16u) | digits.y, (digits.z << 16u) | digits.w), rest);
}
