//! Tests of chains of steps.

use super::*;
use crate::transform::{LogParams, Named};

fn of(transforms: &[(Transform, bool)]) -> Result<Processor, Refused> {
    let mut processor = Processor::default();
    for (transform, inverse) in transforms {
        processor.push(transform, *inverse)?;
    }
    Ok(processor)
}

fn diagonal(v: f64, offset: f64) -> Transform {
    let mut matrix = [0.0; 16];
    (matrix[0], matrix[5], matrix[10], matrix[15]) = (v, v, v, 1.0);
    Transform::Matrix(matrix, [offset, offset, offset, 0.0])
}

#[test]
fn matrices_are_merged_and_inverted() {
    let p = of(&[(diagonal(2.0, 1.0), false), (diagonal(2.0, 1.0), true)]).unwrap();
    assert!(p.is_identity());
    let p = of(&[(diagonal(2.0, 1.0), false), (diagonal(3.0, 0.0), false)]).unwrap();
    assert_eq!((p.steps.len(), p.map([1.0, 2.0, 3.0])), (1, [9.0, 15.0, 21.0]));
}

#[test]
fn every_transform_and_its_inverse_lead_back() {
    let cdl = Cdl {
        slope: [1.2, 0.9, 1.0],
        offset: [0.01, 0.02, 0.0],
        power: [1.1, 0.9, 1.0],
        saturation: 0.8,
        clamp: false,
    };
    let lut = crate::table::Lut1d {
        table: (0..64).map(|i| [(i as f32 / 63.0).powi(2); 3]).collect(),
        interpolation: Interpolation::Linear,
    };
    let log = LogParams { lin_break: Some([0.01; 3]), ..LogParams::pure(10.0) };
    for transform in [
        Transform::Exponent([2.2, 1.8, 2.4, 1.0], Negatives::Clamp),
        Transform::ExponentWithLinear([2.4, 2.4, 2.2, 1.0], [0.055, 0.055, 0.1, 0.0], Negatives::Mirror),
        Transform::Log(log),
        Transform::Cdl(cdl),
        Transform::Range([Some(0.0), Some(1.0), Some(0.1), Some(0.9)], true),
        Transform::Named(Named::LinearToPq),
        Transform::Fixed(Fixed::XyzToXyy),
        Transform::Fixed(Fixed::XyzToUvy),
        Transform::Fixed(Fixed::Surround(0.8)),
        Transform::Fixed(Fixed::GamutCompression([1.147, 1.264, 1.312, 0.815, 0.803, 0.88, 1.2])),
        Transform::Lut1d(Arc::new(lut)),
    ] {
        let p = of(&[(transform.clone(), false), (transform.clone(), true)]).unwrap();
        for rgb in [[0.2, 0.4, 0.6], [0.9, 0.05, 0.5]] {
            let back = p.map(rgb);
            assert!(
                back.iter().zip(rgb).all(|(a, b)| (a - b).abs() < 2e-5),
                "{transform:?} {rgb:?} {back:?}"
            );
        }
    }
}

#[test]
fn decision_lists_are_those_of_the_definition() {
    // ASC CDL 1.2: (in * slope + offset) ^ power, then saturation about the luminance.
    let cdl = Cdl {
        slope: [2.0, 1.0, 1.0],
        offset: [0.0, 0.1, 0.0],
        power: [1.0, 1.0, 2.0],
        saturation: 0.5,
        clamp: true,
    };
    let got = of(&[(Transform::Cdl(cdl), false)]).unwrap().map([0.2, 0.3, 0.5]);
    let graded = [0.4_f64, 0.4, 0.25];
    let luma: f64 = graded.iter().zip(LUMA).map(|(v, w)| v * w).sum();
    for (got, v) in got.iter().zip(graded) {
        assert!((f64::from(*got) - (luma + 0.5 * (v - luma))).abs() < 1e-6);
    }
    let clamped = of(&[(Transform::Cdl(cdl), false)]).unwrap().map([9.0, -1.0, 9.0]);
    assert!(clamped.iter().all(|v| (0.0..=1.0).contains(v)), "{clamped:?}");
}

#[test]
fn what_has_no_inverse_is_refused_by_name() {
    let cube = Lut3d { edge: 2, table: vec![[0.0; 3]; 8], interpolation: Interpolation::Linear };
    let mut alpha = [0.0; 16];
    (alpha[0], alpha[5], alpha[10], alpha[15]) = (1.0, 1.0, 1.0, 2.0);
    for (transform, expected) in [
        (Transform::Lut3d(Arc::new(cube)), "the inverse of a table of three dimensions"),
        (Transform::Matrix([0.0; 16].map(|v: f64| v), [0.0; 4]), "a matrix that mixes alpha with colours"),
        (diagonal(0.0, 0.0), "the inverse of a singular matrix"),
        (Transform::Exponent([0.0, 1.0, 1.0, 1.0], Negatives::Clamp), "a transform without an inverse"),
        (Transform::Matrix(alpha, [0.0; 4]), "a matrix that mixes alpha with colours"),
        (Transform::Exponent([1.0, 1.0, 1.0, 2.0], Negatives::Clamp), "an exponent of alpha"),
        (Transform::Unsupported("GradingToneTransform".to_owned()), "the transform GradingToneTransform"),
    ] {
        assert_eq!(of(&[(transform, true)]).unwrap_err().0, expected);
    }
}

#[test]
fn channels_and_batches_do_not_matter() {
    let p = of(&[
        (diagonal(2.0, 0.0), false),
        (Transform::Exponent([2.2; 4].map(|v: f64| v), Negatives::Pass), false),
    ]);
    assert!(p.is_err(), "alpha has an exponent");
    let p = of(&[
        (diagonal(2.0, 0.0), false),
        (Transform::Exponent([2.2, 2.2, 2.2, 1.0], Negatives::Pass), false),
    ])
    .unwrap();
    let single = p.map([0.1, 0.2, 0.3]);
    let mut many: Vec<f32> = (0..1000).flat_map(|_| [0.1, 0.2, 0.3, 0.7, 0.8]).collect();
    p.apply(&mut many, 5);
    for pixel in many.chunks(5) {
        assert_eq!(pixel, [single[0], single[1], single[2], 0.7, 0.8]);
    }
    let mut grey = [0.1, 0.7, 0.2, 0.6, 0.5];
    p.apply(&mut grey, 2);
    assert_eq!(grey, [single[0], 0.7, single[1], 0.6, 0.5]);
    p.apply(&mut [], 4);
    p.apply(&mut [1.0], 0);
    assert!(!p.is_separable() && Processor::power(2.0).is_separable() && Processor::power(0.0).is_identity());
}

#[test]
fn associated_colours_are_divided_by_alpha() {
    let p = Processor::power(2.0);
    let mut pixels = [0.25, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0];
    p.apply_associated(&mut pixels, 4, 3);
    assert_eq!(pixels, [0.125, 0.0, 0.5, 0.5, 0.25, 0.25, 0.25, 0.0]);
    let mut pixels = [0.25, 0.0, 0.5];
    p.apply_associated(&mut pixels, 3, 3);
    assert_eq!(pixels, [0.0625, 0.0, 0.25]);
    let mut grey = [0.25, 0.5];
    p.apply_associated(&mut grey, 2, 1);
    assert_eq!(grey, [0.125, 0.5]);
}

#[test]
fn chains_are_those_of_their_parts() {
    let (a, b) =
        (Processor::power(2.0), Processor::matrix([[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
    assert_eq!(a.then(&b).map([0.5, 0.5, 0.5]), [0.5, 0.25, 0.25]);
    assert_eq!(b.then(&b).then(&a).map([0.25, 0.5, 0.5]), [1.0, 0.25, 0.25]);
    assert!(Processor::identity().then(&Processor::identity()).is_identity());
    let (rest, matrix, offset) = a.then(&b).split_matrix();
    assert_eq!((Processor::matrix(matrix), offset, rest), (b.clone(), [0.0; 3], a.clone()));
    assert_eq!(a.split_matrix(), (a.clone(), IDENTITY, [0.0; 3]));
    let double = b.then(&b).then(&a).then(&b).first_matrices();
    assert_eq!((double[0][0], a.then(&b).first_matrices()), (4.0, IDENTITY));
    assert_eq!(b.then(&a).split_curves(), (b.clone(), a.clone()));
    assert_eq!(a.then(&b).split_curves(), (a.then(&b), Processor::identity()));
}
