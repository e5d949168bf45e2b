//! Tests the bytes of a screen.

use super::*;
use proptest::prelude::*;

fn ready(display: Display, encoded: bool) -> Prepared {
    Prepared::new(&display, Meaning::Color, encoded, false, &mut Tables::default())
}

#[test]
fn bytes_are_displayed_unchanged() {
    let p = ready(Display::default(), true);
    for i in 0..=255_u8 {
        let v = f32::from(i) / 255.0;
        assert_eq!(p.show([v, v, v, 1.0], 0, 0), [i, i, i, 255]);
    }
}

#[test]
fn srgb_encoding_is_exact_to_half_a_code_value() {
    let p = ready(Display::default(), false);
    for i in 0..10_000 {
        let v = i as f32 / 8000.0;
        let exact = f64::from(srgb_encode(v.min(1.0))) * 255.0;
        let got = f64::from(p.show([v, v, v, 1.0], 0, 0)[0]);
        assert!((got - exact).abs() < 0.54, "{v}: {got} for {exact}");
    }
}

#[test]
fn an_exposure_of_one_stop_doubles_values() {
    let one = ready(Display { exposure: 1.0, ..Display::default() }, false);
    let none = ready(Display::default(), false);
    assert_eq!(one.show([0.1, 0.2, 0.4, 1.0], 0, 0), none.show([0.2, 0.4, 0.8, 1.0], 0, 0));
    let plain = ready(Display { srgb: false, gamma: 2.0, ..Display::default() }, false);
    assert_eq!(plain.show([0.25, 1.0, 4.0, 1.0], 0, 0), [128, 255, 255, 255]);
}

#[test]
fn nan_infinite_and_negative_pixels_are_marked() {
    let all = ready(Display { marks: Marks::Negative, ..Display::default() }, false);
    let off = ready(Display { marks: Marks::Off, ..Display::default() }, false);
    for (v, mark) in
        [(f32::NAN, NAN), (f32::INFINITY, INFINITE), (f32::NEG_INFINITY, MINUS_INFINITE), (-0.5, NEGATIVE)]
    {
        assert_eq!(all.show([0.1, v, 0.1, 1.0], 0, 0), mark);
        assert_eq!(off.show([0.1, v, 0.1, 1.0], 0, 0)[3], 255);
    }
    assert_ne!(ready(Display::default(), false).show([-1.0; 4], 0, 0), NEGATIVE);
    assert_eq!(all.show([f32::MAX, f32::MIN_POSITIVE, 0.0, 1.0], 0, 0), [255, 0, 0, 255]);
}

#[test]
fn display_tables_are_reused() {
    let mut tables = Tables::default();
    let mut shown = |exposure: f32| {
        let display = Display { exposure, ..Display::default() };
        Prepared::new(&display, Meaning::Color, false, false, &mut tables).shown
    };
    let first = shown(0.0);
    assert!(Arc::ptr_eq(&first, &shown(0.0)) && !Arc::ptr_eq(&first, &shown(1.0)));
    (2..9).for_each(|e| drop(shown(e as f32)));
    assert!(!Arc::ptr_eq(&first, &shown(0.0)), "the last few are kept");
    assert_eq!(tables.0.len(), Tables::KEPT);
}

/// Generates values of every kind, such as special values, values at the ends of tables, and any others.
fn any_value() -> impl Strategy<Value = f32> {
    let odd = vec![
        f32::NAN,
        -f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        0.0,
        -0.0,
        f32::MIN_POSITIVE,
        -f32::MIN_POSITIVE,
        f32::from_bits(1),
        -f32::from_bits(1),
        f32::from_bits(0x007f_ffff),
        LEAST,
        LEAST.next_down(),
        f32::from_bits(BELOW),
        f32::from_bits(BELOW - 1),
        MOST,
        MOST.next_down(),
        MOST.next_up(),
        f32::MAX,
        f32::MIN,
        1.0,
        1.0_f32.next_down(),
        1e29,
        1e30,
        -0.25,
    ];
    prop_oneof![
        2 => proptest::sample::select(odd),
        3 => 0.0_f32..1.5,
        1 => -2.0_f32..0.0,
        1 => any::<u32>().prop_map(f32::from_bits),
    ]
}

fn any_display() -> impl Strategy<Value = Display> {
    use proptest::sample::select;
    let colors = select(ColorMap::ALL.to_vec()).prop_flat_map(|map| {
        (-2.0_f32..1.0, 0.5_f32..9.0, any::<bool>()).prop_map(move |(low, high, log)| FalseColor {
            map,
            low,
            high,
            log,
        })
    });
    let channels = select(vec![Channels::Color, Channels::Red, Channels::Luminance, Channels::One(0)]);
    let marks = select(vec![Marks::Off, Marks::Broken, Marks::Negative]);
    let background = select(vec![Background::Ignored, Background::Grey, Background::Checker]);
    (
        (select(vec![0.0_f32, 1.0, -3.5, 20.0]), select(vec![1.0_f32, 2.2]), any::<bool>()),
        (channels, marks, background),
        prop_oneof![2 => Just(None), 1 => colors.prop_map(Some)],
        prop_oneof![3 => Just(None), 1 => Just(Some((0.25, 4.0))), 1 => Just(Some((1e3, 0.0)))],
    )
        .prop_map(|((exposure, gamma, srgb), (channels, marks, background), false_color, range)| {
            Display { exposure, gamma, srgb, channels, false_color, range, marks, background }
        })
}

proptest! {
    /// A row that is converted at once equals its pixels converted one by one.
    #[test]
    fn rows_convert_like_their_single_pixels(
        display in any_display(),
        meaning in proptest::sample::select(vec![Meaning::Color, Meaning::Depth, Meaning::Number]),
        (encoded, unassociated) in any::<(bool, bool)>(),
        alpha in prop_oneof![Just(None), Just(Some(1.0_f32)), Just(Some(0.5))],
        pixels in prop::collection::vec((prop::array::uniform4(any_value()), prop::bool::weighted(0.9)), 0..70),
        y in 0..40_u32,
    ) {
        let ready = Prepared::new(&display, meaning, encoded, unassociated, &mut Tables::default());
        let (mut pixels, covered): (Vec<[f32; 4]>, Vec<bool>) = pixels.into_iter().unzip();
        if let Some(alpha) = alpha {
            pixels.iter_mut().for_each(|p| p[3] = alpha);
        }
        let mut out = vec![7; 4 * pixels.len()];
        ready.show_row(&pixels, &covered, y, &mut out);
        for (x, ((pixel, covered), out)) in (0..).zip(pixels.iter().zip(&covered).zip(out.chunks(4))) {
            let one = if *covered { ready.show(*pixel, x, y) } else { BESIDE };
            prop_assert_eq!(out, one, "{:?} at {}", pixel, x);
        }
    }
}

#[test]
fn images_are_composited_over_backgrounds() {
    let p = |background, unassociated| {
        let d = Display { background, srgb: false, ..Display::default() };
        Prepared::new(&d, Meaning::Color, false, unassociated, &mut Tables::default())
    };
    assert_eq!(p(Background::White, false).show([0.25, 0.0, 0.0, 0.5], 0, 0)[..2], [191, 128]);
    assert_eq!(p(Background::White, true).show([0.5, 0.0, 0.0, 0.5], 0, 0)[..2], [191, 128]);
    let checker = p(Background::Checker, false);
    assert_ne!(checker.show([0.0; 4], 0, 0), checker.show([0.0; 4], 16, 0));
    assert_eq!(p(Background::Ignored, false).show([1.0, 0.0, 0.0, 0.0], 0, 0), [255, 0, 0, 255]);
}

#[test]
fn near_depths_are_bright() {
    let d = Display { range: Some((10.0, 2.0)), ..Display::default() };
    let p = Prepared::new(&d, Meaning::Depth, false, false, &mut Tables::default());
    let grey = |z: f32| p.show([z, z, z, 1.0], 0, 0)[0];
    assert_eq!([grey(2.0), grey(6.0), grey(10.0), grey(1e30), grey(f32::INFINITY)], [255, 128, 0, 0, 0]);
}

#[test]
fn false_colors_follow_the_value() {
    let f = FalseColor { map: ColorMap::Grey, low: 0.25, high: 4.0, log: true };
    let p = ready(Display { false_color: Some(f), ..Display::default() }, false);
    let at = |v: f32| p.show([v, v, v, 1.0], 0, 0)[0];
    assert_eq!([at(0.1), at(0.25), at(1.0), at(4.0), at(9.0)], [0, 0, 128, 255, 255]);
}
