//! Tests images: their data and their attributes (reference 2.3, 4.2, 7.5).

use crate::support::{Place, SHADERS, asks, assert_near, at, middle, scene};
use granita_base::Filter;

/// Returns the declaration of a float image of these data, in addition to the image of the camera.
fn output(file: &str, data: &str, more: &str) -> String {
    format!(
        "Output (\"@/{file}\", \"tiff\", \"{data}\", \"camera\", \"int[4] quantize\", (0, 0, 0, 0), \"float dither\", 0{more})\n"
    )
}

const ONE_PIXEL: &str = ", \"string filter\", \"box\", \"float[2] filterwidth\", (1, 1)";

#[test]
fn float_files_store_the_exact_values() {
    let place = Place::new();
    let square = asks(
        &place,
        "output color Cspec = 0, output float once = 0",
        "C = color (0.1, -2.5, 1e6); opacity = 1; N = normal (0.3, 0.7, -0.1); Cspec = color (0.2, 1e-6, 3); once = 7;",
    );
    let mut before = SHADERS.to_owned();
    for (file, data) in
        [("rgb.tif", "rgb"), ("n.tif", "normal N"), ("spec.tif", "color Cspec"), ("once.tif", "float once")]
    {
        before += &output(file, data, ONE_PIXEL);
    }
    before += &output("z.tif", "z", "");
    before += &output("avgz.tif", "avgz", "");
    before += &output("volz.tif", "volz", "");
    // Another square lies behind it, at a depth of 7.5.
    let world = format!("{square}Translate (0, 0, 2.5)\n{}", crate::support::SQUARE);
    let rgba = place.seen(&before, &world);
    for (file, wanted) in [
        ("rgb.tif", &[0.1, -2.5, 1e6][..]),
        ("n.tif", &[0.3, 0.7, -0.1]),
        ("spec.tif", &[0.2, 1e-6, 3.0]),
        ("once.tif", &[7.0]),
        ("z.tif", &[5.0]),
        ("avgz.tif", &[6.25]),
        // The volume is opaque from this depth on, and nothing transparent is in front of it.
        ("volz.tif", &[5.0, 0.0, 1e30, 1e30, 1e30]),
    ] {
        let image = place.image(file);
        assert_eq!(image.channels, wanted.len(), "{file}");
        for (x, y) in [(0, 0), (7, 9), (15, 15)] {
            assert_eq!(image.pixel(x, y).unwrap(), wanted, "{file} {x} {y}");
        }
    }
    assert_eq!(rgba.pixel(7, 9).unwrap(), [0.1, -2.5, 1e6, 1.0]);
}

#[test]
fn each_filter_has_its_shape_and_width() {
    // The strip is one pixel wide. The value of each pixel is the part of its filter that lies over the strip.
    let strip =
        "Patch (\"linear\", 2, 2, \"vertex point P\", (0, -2, 0, 0.125, -2, 0, 0, 2, 0, 0.125, 2, 0))\n";
    let place = Place::new();
    let mut before = "Attribute (\"int[2] spatialquality\", (16, 16))\n".to_owned();
    let widths = [2.0_f32, 3.0, 4.0];
    for filter in Filter::ALL {
        for width in widths {
            before += &output(
                &format!("{}{width}.tif", filter.word()),
                "rgba",
                &format!(
                    ", \"string filter\", \"{}\", \"float[2] filterwidth\", ({width}, 1)",
                    filter.word()
                ),
            );
        }
    }
    place.seen(&before, strip);
    let mut seen = Vec::new();
    for filter in Filter::ALL {
        for width in widths {
            let image = place.image(&format!("{}{width}.tif", filter.word()));
            let column = |x: usize| image.mean([x, 0, x + 1, 16]).unwrap()[3];
            let over = |from: f32, to: f32| {
                let steps = 400;
                let place = |k: usize| from + (to - from) * (k as f32 + 0.5) / steps as f32;
                (0..steps).map(|k| filter.weight(place(k), width)).sum::<f32>() * (to - from) / steps as f32
            };
            let whole = over(-0.5 * width, 0.5 * width);
            let mut row = Vec::new();
            // The strip is in column 8.
            for x in 5..12_usize {
                let by = 8.0 - x as f32;
                let (found, wanted) = (column(x), over(by - 0.5, by + 0.5) / whole);
                assert!(
                    (found - wanted).abs() < 0.002,
                    "{filter:?} {width}: {found}, not {wanted} in column {x}"
                );
                row.push((found * 100.0).round() as i32);
            }
            // The filter does not reach beyond its width.
            let reach = (0.5 * width + 0.5) as usize;
            assert!(column(8 - reach - 1) == 0.0 && column(8) > 0.2);
            seen.push(row);
        }
    }
    seen.sort();
    seen.dedup();
    assert!(seen.len() >= 18, "the filters differ: {}", seen.len());
}

#[test]
fn filter_widths_apply_per_direction() {
    let place = Place::new();
    let corner = "Patch (\"linear\", 2, 2, \"vertex point P\", (0, 0, 0, 0.125, 0, 0, 0, 0.125, 0, 0.125, 0.125, 0))\n";
    let filter = ", \"string filter\", \"box\", \"float[2] filterwidth\", (3, 1)";
    place.seen(&output("wide.tif", "rgba", filter), corner);
    let wide = place.image("wide.tif");
    for (dx, dy, wanted) in
        [(0, 0, 1.0 / 3.0), (1, 0, 1.0 / 3.0), (-1, 0, 1.0 / 3.0), (0, 1, 0.0), (2, 0, 0.0)]
    {
        let (x, y) = (0.0625 + dx as f32 * 0.125, 0.0625 + dy as f32 * 0.125);
        assert_near(&at(&wide, x, y)[3..], &[wanted], 1e-6, &format!("{dx} {dy}"));
    }
}

#[test]
fn near_depths_merge_to_one_volume_surface() {
    // Within each pixel the depth changes by 0.16 on the left, and by 0.02 on the right.
    let world = "Patch (\"linear\", 2, 2, \"vertex point P\", (-1, -1, -1.28, 0, -1, 0, -1, 1, -1.28, 0, 1, 0))\n\
                 Patch (\"linear\", 2, 2, \"vertex point P\", (0, -1, 0, 1, -1, 0.16, 0, 1, 0, 1, 1, 0.16))\n";
    let place = Place::new();
    let before =
        output("usual.tif", "volz", "") + &output("wide.tif", "volz", ", \"float opaquewidth\", 0.2");
    place.quiet(&scene(&before, world));
    let (usual, wide) = (place.image("usual.tif"), place.image("wide.tif"));
    let depth = |x: f32| 5.0 + if x < 0.0 { 1.28 * x } else { 0.16 * x };
    for i in 0..16 {
        let x = middle(i);
        let (a, b) = (at(&usual, x, 0.3), at(&wide, x, 0.3));
        // There is one surface at the mean of the depths, and nothing in front of it.
        assert!((b[0] - depth(x)).abs() < 0.02 && b[1] == 0.0, "{x}: {b:?}");
        if x < 0.0 {
            // Depths that differ from the farthest by more than 0.05 count as a transparent surface in front of it.
            assert!(a[1] > 0.4 && a[1] < 0.9 && a[0] > b[0] + 0.03, "{x}: {a:?}");
        } else {
            assert_eq!(a, b, "{x}");
        }
    }
}
