//! Prints the content of image files as the bundled formats read it. Run it as `cargo run --example imageinfo FILE...`.
#![allow(clippy::print_stdout, reason = "an example")]

fn main() {
    let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
    for name in std::env::args().skip(1) {
        let input = match formats.open(name.as_ref()) {
            Ok(input) => input,
            Err(error) => {
                println!("{error}");
                continue;
            }
        };
        for image in 0..input.images() {
            for level in 0..input.levels(image) {
                let Some(spec) = input.spec(image, level) else { continue };
                let size = (spec.width, spec.height, spec.tile_width, spec.tile_height);
                println!(
                    "{name} [{image}/{level}] {}: {size:?} {:?} {:?}",
                    input.format_name(),
                    spec.pixel_type,
                    spec.channels
                );
                for p in &spec.attributes {
                    println!("    {} = {:?}", p.declaration(), p.data);
                }
                match input.read_level(image, level) {
                    Ok(pixels) => {
                        let v = pixels.to_floats();
                        let mean = v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
                        println!("    mean {mean}, NaN {}", v.iter().filter(|v| v.is_nan()).count());
                    }
                    Err(error) => println!("    {error}"),
                }
            }
        }
    }
}
