//! Tests of the search for NaN.

use crate::fixture::*;
use granita_base::{Params, Severity};
use granita_shade::Executor;

#[test]
fn nan_is_reported_with_shader_line_and_values() {
    let source = "surface t (float a = -4) {
        float x = u - 2;
        float y = 0;
        if (u > 0.4) y = log (x);
        C = y + 1;
        C = sqrt (a);
    }";
    let group = link(&[(source, Params::new())], &[]);
    let mut services = Double::default();
    let mut executor = Executor::new();
    executor.look_for_nan(true);
    for _ in 0..2 {
        let mut grid = square(3, 2);
        grid.object = "ball".into();
        executor.run(&group, &mut grid, &mut services, &[]);
    }
    let said: Vec<&str> = services.said.iter().map(|(_, t)| t.as_str()).collect();
    assert!(services.said.iter().all(|(s, _)| *s == Severity::Warning));
    // The warnings name the origin of a NaN, and not the values that depend on it.
    assert_eq!(
        said,
        [
            "test.gsl:4: shader \"t\": log of -1.5 gives NaN (in `y`), point 1",
            // The value is the same for all points, and known before the shader runs.
            "test.gsl:6: shader \"t\": sqrt of -4 gives NaN, point 0",
        ]
    );
    // When the search is off, there are no warnings.
    let mut services = Double::default();
    Executor::new().run(&link(&[(source, Params::new())], &[]), &mut square(3, 2), &mut services, &[]);
    assert_eq!(services.said.len(), 0);
}
