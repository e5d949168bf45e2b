// tidy: tests
//! Operations on images: values, windows and channels.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_edit::{
    Binary, DiffLimits, FillMode, Image, Noise, Pattern, Resampling, Turn, Verdict, append_channels, binary,
    difference, mosaic, multiply_add, over, paste, pattern, statistics,
};
use granita_image::PixelType;
use granita_texture::Up;
use granita_texture::make::{Directions, Kernel};
use support::{all, apart, constant, from_below, in_parts, noise, values, window};

/// Images of all operations that request several rows of their inputs.
fn operations() -> Vec<(&'static str, Image)> {
    let wide = noise(window(3, -2, 61, 47), 4, 1).with_full(window(0, 0, 70, 40)).unwrap();
    let grey = noise(window(0, 0, 33, 50), 1, 2);
    let filter = |kernel| Resampling::Filter(Some(kernel));
    vec![
        ("smaller", wide.resized(&window(0, 0, 20, 13), Resampling::Filter(None)).unwrap()),
        ("larger", wide.resized(&window(5, 6, 150, 90), Resampling::Filter(None)).unwrap()),
        ("narrow", wide.resized(&window(0, 0, 9, 90), filter(Kernel::Mitchell)).unwrap()),
        ("radial", wide.resized(&window(0, 0, 40, 50), filter(Kernel::RadialLanczos3)).unwrap()),
        ("disk", grey.resized(&window(0, 0, 11, 20), filter(Kernel::Disk)).unwrap()),
        ("linear", wide.resized(&window(0, 0, 50, 80), Resampling::Sample(true)).unwrap()),
        ("nearest", grey.resized(&window(0, 0, 50, 80), Resampling::Sample(false)).unwrap()),
        (
            "fit",
            wide.fitted(&window(0, 0, 50, 50), FillMode::Letterbox, true, Resampling::Filter(None)).unwrap(),
        ),
        ("blur", wide.blurred((5.0, 9.0), Kernel::Gaussian).unwrap()),
        ("disk blur", grey.blurred((7.0, 7.0), Kernel::Disk).unwrap()),
        ("unsharp", grey.sharpened(3.0, Kernel::Gaussian, 1.0, 0.1).unwrap()),
        ("add", binary(Binary::Add, &wide, &grey).unwrap()),
        ("mad", multiply_add(&wide, &grey, &wide).unwrap()),
        ("over", over(&wide, &grey).unwrap()),
        ("paste", paste(&grey, &wide, Some((-10, 30)), true).unwrap()),
        ("mosaic", mosaic(&[wide.clone(), grey.clone(), wide.clone()], (2, 2), 3).unwrap()),
        ("transpose", wide.turned(Turn::TRANSPOSE, 1 << 20).unwrap()),
        ("clockwise", wide.turned(Turn::CLOCKWISE, 500).unwrap()),
        ("half", wide.turned(Turn::HALF, 500).unwrap()),
        ("shift", wide.shifted((-13, 20)).unwrap()),
        ("crop", wide.crop(&window(-5, 10, 30, 50)).unwrap()),
        ("channels", wide.channels("B,x=0.5,A,R").unwrap().0),
        ("append", append_channels(&wide, &grey).unwrap()),
        ("sum", wide.channel_sum(&[0.2, 0.7, 0.1])),
        ("noise", wide.with_noise(Noise::Gaussian { mean: 0.0, deviation: 0.1 }, false, 3)),
        ("finite", wide.with_constant(Binary::Div, &[0.0]).unwrap().finite(true)),
    ]
}

#[test]
fn values_do_not_depend_on_requests_and_threads() {
    let bits = |v: Vec<f32>| v.into_iter().map(f32::to_bits).collect::<Vec<u32>>();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for (name, image) in operations() {
        let expected = bits(all(&image));
        assert_eq!(expected.len(), image.source().shape().row() * image.spec().height as usize, "{name}");
        for step in [1, 2, 7, 1000] {
            assert_eq!(bits(in_parts(&image, step)), expected, "{name} {step}");
        }
        assert_eq!(bits(from_below(&image)), expected, "{name} from below");
        assert_eq!(bits(one.install(|| all(&image))), expected, "{name} one thread");
        assert_eq!(bits(three.install(|| in_parts(&image, 5))), expected, "{name} three threads");
    }
}

#[test]
fn constants_keep_their_value_in_every_size_and_filter() {
    let image = constant(window(0, 0, 20, 10), &[0.25, 0.5]);
    for (name, kernel) in Kernel::NAMES {
        for (w, h) in [(20, 5), (7, 3), (45, 10), (1, 1)] {
            let resized = image.resized(&window(0, 0, w, h), Resampling::Filter(Some(kernel))).unwrap();
            for pixel in all(&resized).chunks(2) {
                assert!(
                    (pixel[0] - 0.25).abs() < 1e-5 && (pixel[1] - 0.5).abs() < 1e-5,
                    "{name} {w}: {pixel:?}"
                );
            }
        }
    }
    let blurred = image.blurred((5.0, 3.0), Kernel::Gaussian).unwrap();
    assert!(apart(&all(&blurred), &all(&image)) < 1e-6);
}

#[test]
fn resized_values_are_weighted_sums() {
    // The box over two pixels is their mean.
    let image = values(4, &[1.0, 3.0, 5.0, 9.0]);
    let half = image.resized(&window(0, 0, 2, 1), Resampling::Filter(Some(Kernel::Box))).unwrap();
    assert_eq!(all(&half), [2.0, 7.0]);
    let triangle =
        values(3, &[0.0, 4.0, 8.0]).resized(&window(0, 0, 6, 1), Resampling::Sample(true)).unwrap();
    assert!(apart(&all(&triangle), &[0.0, 1.0, 3.0, 5.0, 7.0, 8.0]) < 1e-5);
    let nearest =
        values(3, &[0.0, 4.0, 8.0]).resized(&window(0, 0, 6, 1), Resampling::Sample(false)).unwrap();
    assert_eq!(all(&nearest), [0.0, 0.0, 4.0, 4.0, 8.0, 8.0]);
    let blurred = values(5, &[0.0, 0.0, 3.0, 0.0, 0.0]).blurred((3.0, 1.0), Kernel::Box).unwrap();
    assert!(apart(&all(&blurred), &[0.0, 1.0, 1.0, 1.0, 0.0]) < 1e-6);
}

#[test]
fn missing_pixels_are_black_and_borders_repeat() {
    let image = constant(window(3, 3, 10, 10), &[1.0]).with_full(window(0, 0, 16, 16)).unwrap();
    let half = image.resized(&window(0, 0, 8, 8), Resampling::Filter(Some(Kernel::Box))).unwrap();
    assert_eq!((half.data(), half.full()), (window(1, 1, 5, 5), window(0, 0, 8, 8)));
    assert_eq!(&all(&half)[..5], [0.25, 0.5, 0.5, 0.5, 0.5]);
    let other = image.resized(&window(0, 0, 15, 15), Resampling::Sample(true)).unwrap();
    assert_eq!(other.data(), window(2, 2, 10, 10));
    let fitted = constant(window(0, 0, 10, 10), &[1.0])
        .fitted(&window(0, 0, 40, 30), FillMode::Letterbox, false, Resampling::Filter(None))
        .unwrap();
    assert_eq!((fitted.data(), fitted.full()), (window(5, 0, 30, 30), window(0, 0, 40, 30)));
    let wide = constant(window(0, 0, 10, 10), &[1.0])
        .fitted(&window(0, 0, 40, 30), FillMode::Width, false, Resampling::Filter(None))
        .unwrap();
    assert_eq!(wide.data(), window(0, -5, 40, 40));
}

#[test]
fn windows_are_cropped_cut_and_moved() {
    let image = values(3, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).at(10, 20).unwrap();
    let cropped = image.crop(&window(11, 19, 3, 2)).unwrap();
    assert_eq!(all(&cropped), [0.0, 0.0, 0.0, 2.0, 3.0, 0.0]);
    assert_eq!((cropped.data(), cropped.full()), (window(11, 19, 3, 2), window(0, 0, 3, 2)));
    let cut = image.cut(&window(11, 21, 2, 1)).unwrap();
    assert_eq!((all(&cut), cut.data(), cut.full()), (vec![5.0, 6.0], window(0, 0, 2, 1), window(0, 0, 2, 1)));
    assert_eq!(all(&image.crop_to_full().unwrap()), [0.0; 6]);
    assert_eq!(image.full_is_data().unwrap().full(), window(10, 20, 3, 2));
    assert!(all(&image.crop(&window(100, 100, 2, 2)).unwrap()).iter().all(|v| *v == 0.0));
    let trimmed = values(4, &[0.0, 0.0, 0.0, 0.0, 0.0, 7.0, 0.0, 8.0, 0.0, 0.0, 9.0, 0.0]).trim().unwrap();
    assert_eq!((all(&trimmed), trimmed.data()), (vec![7.0, 0.0, 8.0, 0.0, 9.0, 0.0], window(1, 1, 3, 2)));
    assert_eq!(values(2, &[0.0, 0.0]).trim().unwrap().data(), window(0, 0, 1, 1));
    assert_eq!(
        all(&values(3, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).shifted((1, 1)).unwrap()),
        [6.0, 4.0, 5.0, 3.0, 1.0, 2.0]
    );
    let far = i64::from(i32::MAX) + 1;
    assert!(image.at(far, 0).is_err() && image.crop(&window(far, 0, 1, 1)).is_err());
    assert!(image.clone().with_full(window(0, 0, 0, 5)).is_err());
}

#[test]
fn images_are_placed_together() {
    let (a, b) = (values(2, &[1.0, 2.0]), values(1, &[7.0, 8.0]));
    let sheet = mosaic(&[a.clone(), b.clone()], (2, 1), 1).unwrap();
    assert_eq!(
        (sheet.data(), all(&sheet)),
        (window(0, 0, 5, 2), vec![1.0, 2.0, 0.0, 7.0, 0.0, 0.0, 0.0, 0.0, 8.0, 0.0])
    );
    let pasted = paste(&b, &a, Some((1, -1)), true).unwrap();
    assert_eq!((pasted.data(), all(&pasted)), (window(0, -1, 2, 2), vec![0.0, 7.0, 1.0, 8.0]));
    assert!(mosaic(&[], (1, 1), 0).is_err() && mosaic(&[a.clone(), b], (1, 1), 0).is_err());
    assert!(mosaic(&[a], (0, 1), 0).is_err());
}

#[test]
fn the_eight_orientations_are_turned_upright() {
    // The upright image is 1 2 3 over 4 5 6.
    let upright = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    for (orientation, width, stored) in [
        (1, 3, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        (2, 3, [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]),
        (3, 3, [6.0, 5.0, 4.0, 3.0, 2.0, 1.0]),
        (4, 3, [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
        (5, 2, [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]),
        (6, 2, [3.0, 6.0, 2.0, 5.0, 1.0, 4.0]),
        (7, 2, [6.0, 3.0, 5.0, 2.0, 4.0, 1.0]),
        (8, 2, [4.0, 1.0, 5.0, 2.0, 6.0, 3.0]),
    ] {
        let image = values(width, &stored).with_orientation(orientation).unwrap();
        for memory in [0, 1 << 20] {
            let turned = image.upright(memory).unwrap();
            assert_eq!((all(&turned), turned.orientation()), (upright.to_vec(), 1), "{orientation}");
        }
    }
    assert!(values(1, &[1.0]).with_orientation(9).is_err());
}

#[test]
fn windows_are_turned_with_the_image() {
    let image = noise(window(5, 7, 64, 48), 2, 1).with_full(window(0, 0, 100, 80)).unwrap();
    for (turn, data, full) in [
        (Turn::FLIP, window(5, 25, 64, 48), window(0, 0, 100, 80)),
        (Turn::FLOP, window(31, 7, 64, 48), window(0, 0, 100, 80)),
        (Turn::CLOCKWISE, window(25, 5, 48, 64), window(0, 0, 80, 100)),
        (Turn::HALF, window(31, 25, 64, 48), window(0, 0, 100, 80)),
        (Turn::COUNTERCLOCKWISE, window(7, 31, 48, 64), window(0, 0, 80, 100)),
        (Turn::TRANSPOSE, window(7, 5, 48, 64), window(0, 0, 80, 100)),
    ] {
        let turned = image.turned(turn, 1 << 20).unwrap();
        assert_eq!((turned.data(), turned.full()), (data, full), "{turn:?}");
    }
}

#[test]
fn channels_are_selected_named_and_added() {
    let image = constant(window(0, 0, 2, 1), &[0.1, 0.2, 0.3, 1.0]);
    let names = |image: &Image| image.spec().channels.join(",");
    for (list, expected, pixel, notes) in [
        ("B,G", "B,G", vec![0.3, 0.2], 0),
        ("2,0", "B,R", vec![0.3, 0.1], 0),
        ("G=R,B,A=0.5", "G,B,A", vec![0.1, 0.3, 0.5], 0),
        ("r,Z", "R,Z", vec![0.1, 0.0], 1),
        ("R,R,=0.75", "R,channel1,channel2", vec![0.1, 0.1, 0.75], 0),
    ] {
        let (chosen, found) = image.channels(list).unwrap();
        assert_eq!((names(&chosen), found.len()), (expected.to_owned(), notes), "{list}");
        assert_eq!(&all(&chosen)[..pixel.len()], pixel, "{list}");
    }
    assert_eq!(names(&image.with_channels(6)), "R,G,B,A,channel4,channel5");
    assert_eq!(names(&constant(window(0, 0, 1, 1), &[0.5]).with_channels(4)), "Y,G,B,A");
    assert_eq!(names(&image.channel_names("x,,z")), "x,G,z,A");
    assert_eq!(all(&image.channel_sum(&[1.0, 2.0])), [0.5, 0.5]);
    let both = append_channels(&image, &constant(window(0, 0, 1, 1), &[0.5])).unwrap();
    assert_eq!((names(&both), all(&both)[4], all(&both)[9]), ("R,G,B,A,Y".to_owned(), 0.5, 0.0));
    // Bytes stay bytes.
    let bytes = image.converted(PixelType::U8).channels("A,R").unwrap().0;
    assert_eq!(bytes.spec().pixel_type, PixelType::U8);
    assert_eq!(all(&bytes)[..2], [1.0, 26.0 / 255.0]);
}

#[test]
fn arithmetic_follows_its_definitions() {
    let (a, b) = (constant(window(0, 0, 1, 1), &[0.75]), constant(window(0, 0, 1, 1), &[-0.5]));
    let zero = constant(window(0, 0, 1, 1), &[0.0]);
    for (operation, expected) in [
        (Binary::Add, 0.25),
        (Binary::Sub, 1.25),
        (Binary::Mul, -0.375),
        (Binary::Div, -1.5),
        (Binary::AbsDiff, 1.25),
        (Binary::Min, -0.5),
        (Binary::Max, 0.75),
        (Binary::Pow, 0.75_f32.powf(-0.5)),
    ] {
        assert_eq!(all(&binary(operation, &a, &b).unwrap()), [expected], "{operation:?}");
        assert_eq!(all(&a.with_constant(operation, &[-0.5]).unwrap()), [expected], "{operation:?}");
    }
    assert_eq!(all(&binary(Binary::Div, &a, &zero).unwrap()), [0.0]);
    assert_eq!(all(&b.with_constant(Binary::Pow, &[0.5]).unwrap()), [0.0]);
    assert_eq!(all(&b.with_constant(Binary::Pow, &[2.0]).unwrap()), [0.25]);
    assert_eq!(all(&multiply_add(&a, &b, &a).unwrap()), [0.375]);
    assert_eq!(all(&b.abs()), [0.5]);
    let color = constant(window(0, 0, 1, 1), &[0.25, 2.0, -1.0, 0.5]);
    assert_eq!(all(&color.inverted(None)), [0.75, -1.0, 2.0, 0.5]);
    assert_eq!(all(&color.inverted(Some((3, 4)))), [0.25, 2.0, -1.0, 0.5]);
    assert_eq!(all(&color.clamped(Some(&[0.0]), Some(&[1.0]), false).unwrap()), [0.25, 1.0, 0.0, 0.5]);
    assert_eq!(all(&color.premultiplied()), [0.125, 1.0, -0.5, 0.5]);
    assert_eq!(all(&color.unpremultiplied()), [0.5, 4.0, -2.0, 0.5]);
    assert_eq!(all(&color.with_constant(Binary::Add, &[1.0, 2.0]).unwrap()), [1.25, 4.0, 1.0, 2.5]);
    assert!(color.with_constant(Binary::Add, &[]).is_err());
}

#[test]
fn results_cover_all_windows_and_channels() {
    let a = constant(window(0, 0, 2, 1), &[1.0]);
    let b = constant(window(1, 0, 2, 1), &[10.0, 20.0, 30.0]).with_full(window(0, 0, 5, 5)).unwrap();
    let sum = binary(Binary::Add, &a, &b).unwrap();
    assert_eq!((sum.data(), sum.full(), sum.spec().nchannels()), (window(0, 0, 3, 1), window(0, 0, 5, 5), 3));
    assert_eq!(all(&sum), [1.0, 0.0, 0.0, 11.0, 20.0, 30.0, 10.0, 20.0, 30.0]);
}

#[test]
fn images_are_composited_by_alpha() {
    let a = constant(window(0, 0, 1, 1), &[0.25, 0.125, 0.0, 0.5]);
    let b = constant(window(0, 0, 2, 1), &[1.0, 1.0, 1.0, 1.0]);
    let image = over(&a, &b).unwrap();
    assert_eq!(all(&image), [0.75, 0.625, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0]);
    // Without alpha an image is opaque.
    let opaque = constant(window(0, 0, 1, 1), &[0.25, 0.5, 0.75]);
    assert_eq!(all(&over(&opaque, &b).unwrap())[..4], [0.25, 0.5, 0.75, 1.0]);
    assert_eq!(all(&over(&a, &opaque).unwrap()), [0.375, 0.375, 0.375, 1.0]);
}

#[test]
fn broken_values_are_replaced() {
    let image = values(3, &[1.0, f32::NAN, 3.0, f32::INFINITY, 5.0, 6.0]);
    assert_eq!(all(&image.finite(false)), [1.0, 0.0, 3.0, 0.0, 5.0, 6.0]);
    assert_eq!(all(&image.finite(true)), [1.0, 3.75, 3.0, 3.0, 5.0, 6.0]);
    let alone = values(1, &[f32::NAN]);
    assert_eq!(all(&alone.finite(true)), [0.0]);
}

#[test]
fn patterns_are_drawn() {
    let checker = Pattern::Checker { size: (2, 1), colors: [vec![0.25], vec![0.5]], offset: (0, 0) };
    let image = pattern(checker, &window(0, 0, 4, 2), 1).unwrap();
    assert_eq!(all(&image), [0.25, 0.25, 0.5, 0.5, 0.5, 0.5, 0.25, 0.25]);
    let fill = Pattern::Fill([vec![0.0], vec![1.0], vec![2.0], vec![3.0]]);
    assert_eq!(all(&pattern(fill, &window(0, 0, 3, 2), 1).unwrap()), [0.0, 0.5, 1.0, 2.0, 2.5, 3.0]);
    let gaussian = Noise::Gaussian { mean: 0.5, deviation: 0.2 };
    let noise = Pattern::Noise { noise: gaussian, mono: false, seed: 5 };
    let s = statistics(&pattern(noise, &window(0, 0, 100, 100), 3).unwrap()).unwrap();
    assert_eq!((s.len(), s[0].count), (3, 10_000));
    assert!(s.iter().all(|s| (s.mean - 0.5).abs() < 0.01 && (s.deviation() - 0.2).abs() < 0.01), "{s:?}");
    assert!(s[0].mean != s[1].mean);
    assert!(pattern(Pattern::Constant(vec![]), &window(0, 0, 1, 1), 1).is_err());
    assert!(pattern(Pattern::Constant(vec![1.0]), &window(0, 0, 0, 1), 1).is_err());
    assert!(pattern(Pattern::Constant(vec![1.0]), &window(0, 0, 1, 1), 0).is_err());
}

#[test]
fn comparisons_count_pixels_and_judge_them() {
    let (a, b) = (values(4, &[0.0, 0.5, 1.0, f32::NAN]), values(4, &[0.0, 0.51, 1.25, f32::NAN]));
    let limits = DiffLimits { fail: 0.1, warn: 0.005, ..DiffLimits::default() };
    let found = difference(&a, &b, &limits).unwrap();
    assert_eq!(
        (found.pixels, found.failed, found.warned, found.max, found.max_at),
        (4, 1, 2, 0.25, (2, 0, 0))
    );
    assert_eq!(found.verdict(&limits), Verdict::Failure);
    assert_eq!(found.verdict(&DiffLimits { fail_percent: 25.0, ..limits }), Verdict::Warning);
    assert_eq!(
        found.verdict(&DiffLimits { fail_percent: 25.0, warn_percent: 50.0, ..limits }),
        Verdict::Pass
    );
    let hard = DiffLimits { fail_percent: 25.0, warn_percent: 50.0, hard_fail: 0.2, ..limits };
    assert_eq!(found.verdict(&hard), Verdict::Failure);
    let same = difference(&a, &a, &limits).unwrap();
    assert!(same.max == 0.0 && same.psnr.is_infinite() && same.verdict(&limits) == Verdict::Pass);
    let broken = difference(&a, &values(4, &[0.0, 0.5, 1.0, 1.0]), &limits).unwrap();
    assert!(broken.max.is_infinite() && broken.failed == 1);
    assert!(difference(&a, &values(2, &[0.0, 0.0]), &limits).is_err());
}

#[test]
fn maps_of_directions_are_held_within_the_limit() {
    let map = noise(window(0, 0, 64, 32), 3, 1);
    let convert = |to, memory| map.directions((Directions::LatLong, to), Up::Y, None, memory);
    let cross = convert(Directions::Cross, 1 << 20).unwrap();
    assert_eq!(cross.data(), window(0, 0, 64, 48));
    let error = convert(Directions::Cross, 1000).unwrap_err().to_string();
    assert!(error.contains("-memory"), "{error}");
    let error = map
        .directions((Directions::Cube, Directions::LatLong), Up::Y, None, 1 << 20)
        .unwrap_err()
        .to_string();
    assert!(error.contains("3 by 2 square faces"), "{error}");
}
