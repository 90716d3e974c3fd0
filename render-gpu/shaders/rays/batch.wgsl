// A batch of rays or segments.

struct BatchParams {
    count: u32,
    spare0: u32,
    spare1: u32,
    spare2: u32,
}
