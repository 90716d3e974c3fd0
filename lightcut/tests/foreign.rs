//! Runs `examples/foreign.rs`, so that the example cannot rot.

#[path = "../examples/foreign.rs"]
#[expect(dead_code, reason = "the example's main is not called here")]
mod foreign;

#[test]
fn the_foreign_renderer_is_within_its_threshold() {
    let (picture, mean_cut, error) = foreign::render(1000);
    assert!(picture.iter().all(|c| c.is_finite()));
    assert!(picture.iter().filter(|c| c.length() > 0.0).count() > picture.len() / 3, "something is lit");
    assert!(error < 0.02, "relative error {error}");
    assert!(mean_cut < 500.0, "{mean_cut} of 1000 lamps per pixel");
}
