//! Makes shadow maps from depth maps.

use super::MakeOptions;
use super::environment::check_faces;
use super::input::Input;
use super::output::{Body, Extras, Texture};
use crate::cube::FACE_NAMES;
use crate::error::{Result, TextureError};
use crate::image::{Image, half};
use crate::volume::EMPTY;
use crate::{TextureKind, volume};
use granita_base::{BaseType, Param, ParamData, ParamType};
use granita_image::PixelType;

/// Checks that the file or the options provide both matrices.
fn check_matrices(input: &Input, options: &MakeOptions) -> Result<()> {
    let needed =
        [("worldtocamera", options.mcamera, "-Mcamera"), ("worldtoscreen", options.mscreen, "-Mscreen")];
    for (name, given, option) in needed {
        if given.is_none() && input.matrix(name).is_none() {
            let what = format!("it has no {name} matrix, which a shadow map needs; {option} sets one");
            return Err(TextureError::Malformed { path: input.path.clone(), what });
        }
    }
    Ok(())
}

fn texture(kind: TextureKind, body: Body, channels: Vec<String>, input: Input) -> Texture {
    let notes = super::notes_of(std::slice::from_ref(&input));
    let (pixel_type, attributes) = (PixelType::Float, input.attributes);
    Texture {
        kind,
        body,
        up: None,
        channels,
        pixel_type,
        attributes,
        icc_profile: None,
        conversion: None,
        notes,
        extras: Extras::default(),
    }
}

/// Makes the texture of `-shadow`.
pub(crate) fn shadow(mut input: Input, options: &MakeOptions) -> Result<Texture> {
    check_matrices(&input, options)?;
    input.only_depth();
    let image = std::mem::replace(&mut input.image, Image::new(0, 0, 1));
    Ok(texture(TextureKind::Shadow, Body::Flat(vec![image]), vec!["Z".to_owned()], input))
}

/// True when an image holds opacity against depth, as outputs of "volz" do. A single depth has a channel named "z".
fn is_volume(input: &Input) -> bool {
    input.image.channels >= 4 && !input.channels.iter().any(|c| c.eq_ignore_ascii_case("z"))
}

/// Makes the texture of `-shadcube` from the faces px nx py ny pz nz. `None` is a face without shadows. Either all
/// faces are volume depth maps or none is.
pub(crate) fn cube(inputs: Vec<Option<Input>>, options: &MakeOptions) -> Result<Texture> {
    let mut known: Vec<Input> = Vec::new();
    let mut places = Vec::new();
    let volume = inputs.iter().flatten().next().is_some_and(is_volume);
    for (face, input) in inputs.into_iter().enumerate() {
        if let Some(mut input) = input {
            if volume != is_volume(&input) {
                let (this, first) = if volume { ("one depth", "volumes") } else { ("a volume", "one depth") };
                let what =
                    format!("face {} holds {this} for a pixel, those before it {first}", FACE_NAMES[face]);
                return Err(TextureError::Malformed { path: input.path.clone(), what });
            }
            if !volume {
                input.only_depth();
            }
            places.push(face);
            known.push(input);
        }
    }
    if known.is_empty() {
        return Err(TextureError::Misuse { what: "all six faces are empty".to_owned() });
    }
    let n = check_faces(&known, &places)?;
    let mut nothing = Image::new(n, n, known[0].image.channels);
    for texel in nothing.data.chunks_exact_mut(nothing.channels) {
        volume::store(EMPTY, &[], texel);
    }
    let mut faces = vec![nothing; FACE_NAMES.len()];
    for (face, input) in places.iter().zip(&mut known) {
        faces[*face] = std::mem::replace(&mut input.image, Image::new(0, 0, 1));
    }
    // The pz face provides the matrices. Without it the options must, because the other faces have other directions.
    let pz = places.iter().position(|face| FACE_NAMES[*face] == "pz");
    if pz.is_none() && (options.mcamera.is_none() || options.mscreen.is_none()) {
        let what = "without a pz face, -Mcamera and -Mscreen must give the matrices".to_owned();
        return Err(TextureError::Misuse { what });
    }
    let notes = super::notes_of(&known);
    let main = known.swap_remove(pz.unwrap_or(0));
    check_matrices(&main, options)?;
    let faces = <[Image; 6]>::try_from(faces)
        .map_err(|_| TextureError::Misuse { what: "a cube has six faces".to_owned() })?;
    if !volume {
        let body = Body::Cube(vec![faces]);
        return Ok(Texture {
            notes,
            ..texture(TextureKind::CubeFaceShadow, body, main.channels.clone(), main)
        });
    }
    let mut levels = vec![faces];
    while let Some(last) = levels.last().filter(|faces| faces[0].width > 1) {
        let next = std::array::from_fn(|face| halved(&last[face], options.opaque_width));
        levels.push(next);
    }
    Ok(Texture { notes, ..volumes(TextureKind::CubeFaceVolumeShadow, Body::Cube(levels), main, options) })
}

/// Returns a map of opacity against depth, which stores the width of an opaque surface.
fn volumes(kind: TextureKind, body: Body, mut input: Input, options: &MakeOptions) -> Texture {
    let ty = ParamType::of(BaseType::Float);
    let data = ParamData::from(options.opaque_width);
    input.attributes.set(Param { name: "opaquewidth".into(), ty, data });
    let channels = input.channels.clone();
    texture(kind, body, channels, input)
}

/// Makes the texture of `-volshad`, with the channels z_opaque, alpha_trans, z_0 ... z_1 (reference 9.2.4).
pub(crate) fn volume(mut input: Input, options: &MakeOptions) -> Result<Texture> {
    check_matrices(&input, options)?;
    let n = input.image.channels;
    if n < 4 {
        let what = format!("a volume depth map has at least 4 channels, this has {n}");
        return Err(TextureError::Malformed { path: input.path.clone(), what });
    }
    let first = std::mem::replace(&mut input.image, Image::new(0, 0, 1));
    let mut levels = vec![first];
    while let Some(last) = levels.last().filter(|p| p.width > 1 || p.height > 1) {
        let next = halved(last, options.opaque_width);
        levels.push(next);
    }
    Ok(volumes(TextureKind::VolumeShadow, Body::Flat(levels), input, options))
}

/// Returns the next level of a volume map.
fn halved(p: &Image, opaque_width: f32) -> Image {
    let mut out = Image::new(half(p.width), half(p.height), p.channels);
    let range = |o: usize, from: usize, to: usize| o * from / to..((o + 1) * from).div_ceil(to).min(from);
    for y in 0..out.height {
        for x in 0..out.width {
            let mut texels: Vec<&[f32]> = Vec::with_capacity(9);
            for from_y in range(y, p.height, out.height) {
                texels.extend(range(x, p.width, out.width).map(|from_x| p.texel(from_x, from_y)));
            }
            let combined = combine(&texels, opaque_width);
            out.texel_mut(x, y).copy_from_slice(&combined);
        }
    }
    out
}

/// Returns one texel for several. Its opacity at each depth is the mean of theirs.
///
/// Opaque depths within `opaque_width` of the farthest are one surface at their mean depth, where the texel becomes
/// opaque. The nearer ones belong to the transparent part.
pub(crate) fn combine(texels: &[&[f32]], opaque_width: f32) -> Vec<f32> {
    let count = texels.len() as f32;
    let opaque: Vec<f32> = texels.iter().map(|t| t[0]).collect();
    let (opaque, least) = volume::common_surface(&opaque, opaque_width);
    // Texels that share the common surface contribute only their transparent parts.
    let own = |t: &[f32], z: f32| {
        if t[0] >= least {
            volume::opacity(&[&[f32::INFINITY], &t[1..]].concat(), z)
        } else {
            volume::opacity(t, z)
        }
    };
    let mean = |z: f32| texels.iter().map(|t| own(t, z)).sum::<f32>() / count;
    // The slope of the opacity changes only at these depths. At a surface it jumps directly behind its depth.
    let mut depths: Vec<f32> = Vec::new();
    for t in texels {
        if t[1] > 0.0 {
            depths.extend(t[2..].iter().filter(|z| **z < EMPTY));
        }
        if t[0] < least {
            depths.push(t[0]);
        }
    }
    depths.sort_by(f32::total_cmp);
    depths.dedup();
    let mut curve: Vec<(f32, f32)> = Vec::with_capacity(depths.len() * 2);
    let mut last = 0.0_f32;
    for &z in &depths {
        for behind in [z, z.next_up()] {
            last = mean(behind).max(last);
            curve.push((z, last));
        }
    }
    let mut out = vec![EMPTY; texels[0].len()];
    volume::store(opaque, &curve, &mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_texels_combine_to_themselves() {
        let t = [9.0, 0.5, 2.0, 3.0, 6.0];
        let c = combine(&[&t, &t, &t, &t], 0.05);
        for (a, b) in c.iter().zip(t) {
            assert!((a - b).abs() < 1e-4, "{c:?}");
        }
        let empty = [EMPTY, 0.0, EMPTY, EMPTY];
        assert_eq!(combine(&[&empty, &empty], 0.05), empty);
    }

    #[test]
    fn near_surfaces_combine_to_one() {
        let c = combine(&[&[5.0, 0.0, EMPTY, EMPTY], &[5.04, 0.0, EMPTY, EMPTY]], 0.05);
        assert!((c[0] - 5.02).abs() < 1e-5 && c[1] == 0.0, "{c:?}");
    }

    #[test]
    fn distant_surfaces_combine_to_a_step_and_a_surface() {
        let c = combine(&[&[5.0, 0.0, EMPTY, EMPTY], &[8.0, 0.0, EMPTY, EMPTY]], 0.05);
        assert_eq!((c[0], c[1]), (8.0, 0.5));
        assert!((c[2] - 5.0).abs() < 1e-4 && (c[3] - 5.0).abs() < 1e-4, "{c:?}");
        assert_eq!(volume::opacity(&c, 6.0), 0.5);
        assert_eq!(volume::opacity(&c, 4.9), 0.0);
        assert_eq!(volume::opacity(&c, 8.1), 1.0);
    }

    #[test]
    fn mean_opacity_is_kept_at_the_thresholds() {
        let a = [EMPTY, 0.8, 1.0, 2.0, 3.0];
        let b = [EMPTY, 0.4, 2.0, 4.0, 6.0];
        let c = combine(&[&a, &b], 0.05);
        assert!((c[1] - 0.6).abs() < 1e-6);
        for i in 0..3 {
            let mean = 0.5 * (volume::opacity(&a, c[2 + i]) + volume::opacity(&b, c[2 + i]));
            assert!((mean - 0.3 * i as f32).abs() < 1e-4, "{c:?} {i} {mean}");
        }
    }
}
