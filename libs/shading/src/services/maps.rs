//! Lookups in texture, environment and shadow files.

use super::{count, option, samples};
use crate::lighting::directions::EnvironmentSampler;
use granita_base::sample::Draw;
use granita_base::{Transform, Vec3};
use granita_shade::{
    Batch, EnvironmentQuery, Lane, Lanes3, LookupResult, MapHandle, ShadowQuery, Texture3dQuery,
    TextureOptions, TextureQuery,
};
use granita_texture::{
    EnvLookup, Lookup, Lookup3d, ShadowLookup, TextureCache, TextureHandle, TextureId, TextureReader, Up,
    Use, Wrap,
};

/// The largest number of channels that one lookup returns, alpha included.
pub(super) const CHANNELS: usize = 4;

/// Allocates a result. The values of other lanes stay.
pub(super) fn prepare(batch: Batch<'_>, channels: usize, out: &mut LookupResult) {
    out.value.resize(channels, Vec::new());
    for channel in &mut out.value {
        channel.resize(batch.lanes, 0.0);
    }
    out.alpha.resize(batch.lanes, 0.0);
    out.hitdist.clear();
    out.p_hit = Lanes3::default();
    out.n_hit = Lanes3::default();
    out.direction = Lanes3::default();
}

/// Stores `values` (channels, then alpha) for a lane.
pub(super) fn store(out: &mut LookupResult, lane: usize, values: &[f32]) {
    for (channel, value) in out.value.iter_mut().zip(values) {
        channel[lane] = *value;
    }
    out.alpha[lane] = values[out.value.len()];
}

/// Returns the first channel of a lane. Negative and non-finite numbers mean 0.
pub(super) fn first_channel(value: Option<Lane<'_>>, lane: usize) -> u32 {
    option(value, lane, 0.0).clamp(0.0, 65536.0) as u32
}

/// Answers `texture ()` from a cache of files. A file that cannot be used gives `fill` and alpha 0.
pub fn texture(reader: &mut TextureReader<'_>, query: &TextureQuery<'_>, out: &mut LookupResult) {
    let o = &query.options;
    let (swrap, twrap) = wraps(o);
    let TextureQuery { batch, name, handle, channels, .. } = *query;
    let asked = Asked { batch, name, handle, channels, fill: o.fill };
    each(reader, &asked, out, |reader, id, i, fill, values| {
        let lookup = Lookup {
            s: query.s.get(i),
            t: query.t.get(i),
            dsdx: query.dsdx.get(i),
            dtdx: query.dtdx.get(i),
            dsdy: query.dsdy.get(i),
            dtdy: query.dtdy.get(i),
            sblur: option(o.sblur, i, 0.0),
            tblur: option(o.tblur, i, 0.0),
            swidth: option(o.swidth, i, 1.0),
            twidth: option(o.twidth, i, 1.0),
            swrap,
            twrap,
            first_channel: first_channel(o.firstchannel, i),
            fill,
        };
        reader.texture(id, &lookup, values);
    });
}

/// Answers `texture3d ()` from a volume texture, as [`texture`] does.
pub fn texture3d(reader: &mut TextureReader<'_>, query: &Texture3dQuery<'_>, out: &mut LookupResult) {
    let o = &query.options;
    let (swrap, twrap) = wraps(o);
    let Texture3dQuery { batch, name, handle, channels, .. } = *query;
    let asked = Asked { batch, name, handle, channels, fill: o.fill };
    each(reader, &asked, out, |reader, id, i, fill, values| {
        let lookup = Lookup3d {
            p: query.p.get(i),
            dpdx: query.dpdx.get(i),
            dpdy: query.dpdy.get(i),
            sblur: option(o.sblur, i, 0.0),
            tblur: option(o.tblur, i, 0.0),
            swidth: option(o.swidth, i, 1.0),
            twidth: option(o.twidth, i, 1.0),
            swrap,
            twrap,
            first_channel: first_channel(o.firstchannel, i),
            fill,
        };
        reader.texture3d(id, &lookup, values);
    });
}

/// Returns the wrap modes that a shader requests.
fn wraps<N>(options: &TextureOptions<N, &str>) -> (Option<Wrap>, Option<Wrap>) {
    (options.swrap.and_then(Wrap::from_word), options.twrap.and_then(Wrap::from_word))
}

/// Returns the words for wrap modes that are not known. An empty one and "default" stand for the mode of the file.
pub(super) fn unknown_wraps<'o, N>(options: &TextureOptions<N, &'o str>) -> impl Iterator<Item = &'o str> {
    let words = [options.swrap, options.twrap].into_iter().flatten();
    words.filter(|word| !matches!(word.trim(), "" | "default") && Wrap::from_word(word).is_none())
}

/// Returns the map with a name. It is that of the handle if the handle is of this cache; otherwise it is looked up.
fn find(reader: &TextureReader<'_>, name: &str, handle: Option<&MapHandle>, usage: Use) -> Option<TextureId> {
    let cache = reader.cache();
    let kept = handle.and_then(|handle| handle.get_or_find(|| cache.handle_for(name, usage)));
    kept.and_then(|kept: &TextureHandle| cache.id_of(kept)).or_else(|| cache.find_for(name, usage))
}

/// The parameters that lookups in all kinds of textures share.
struct Asked<'q> {
    batch: Batch<'q>,
    name: &'q str,
    handle: Option<&'q MapHandle>,
    channels: usize,
    fill: Option<Lane<'q>>,
}

/// Looks up every point of a query in its file. The function receives the reader, the file, the point's index, the
/// values of channels that the file lacks, and the place of the result.
fn each(
    reader: &mut TextureReader<'_>,
    query: &Asked<'_>,
    out: &mut LookupResult,
    mut look: impl FnMut(&mut TextureReader<'_>, TextureId, usize, f32, &mut [f32]),
) {
    prepare(query.batch, query.channels, out);
    let id = find(reader, query.name, query.handle, Use::Texture);
    let wanted = (query.channels + 1).min(CHANNELS);
    for &lane in query.batch.active {
        let i = lane as usize;
        let fill = option(query.fill, i, 0.0);
        let mut values = [fill; CHANNELS];
        match id {
            Some(id) => look(reader, id, i, fill, &mut values[..wanted]),
            None => values[wanted - 1] = 0.0,
        }
        store(out, i, &values[..wanted]);
    }
}

/// Returns the sampler of the light of a map, in the map's own space.
pub(crate) fn directions(
    textures: &TextureCache,
    id: TextureId,
    up: Option<Up>,
    threads: usize,
) -> EnvironmentSampler {
    EnvironmentSampler::new(threads, &|| {
        let mut reader = textures.reader();
        move |r, angle: f32| {
            let lookup = EnvLookup { r, angle: Some(0.5 * angle), up, quick: true, ..EnvLookup::default() };
            let mut values = [0.0; CHANNELS];
            reader.environment(id, &lookup, &mut values);
            values
        }
    })
}

/// Answers `environment ()` from a map. `space` leads from the map's space to "common"; `None` when they are the
/// same. A file that cannot be used gives `fill` and alpha 0.
pub fn environment(
    reader: &mut TextureReader<'_>,
    query: &EnvironmentQuery<'_>,
    space: Option<Transform>,
    quick: bool,
    out: &mut LookupResult,
) {
    prepare(query.batch, query.channels, out);
    let o = &query.options;
    let id = find(reader, query.name, query.handle, Use::Environment);
    let to_map = space.map_or(Transform::IDENTITY, |m| m.inverse());
    let up = o.up.and_then(Up::from_word);
    let wanted = (query.channels + 1).min(CHANNELS);
    for &lane in query.batch.active {
        let i = lane as usize;
        let fill = option(o.fill, i, 0.0);
        let mut values = [fill; CHANNELS];
        match id {
            Some(id) => {
                let (p, r) = (query.p.get(i), query.r.get(i));
                let radius = option(o.radius, i, 0.0);
                let seen = |p: Vec3, r: Vec3| {
                    let r = to_map.vector(r);
                    if radius > 0.0 { on_sphere(to_map.point(p), r, radius) } else { r }
                };
                let along = seen(p, r);
                let lookup = EnvLookup {
                    r: along,
                    drdx: seen(p + query.dpdx.get(i), r + query.drdx.get(i)) - along,
                    drdy: seen(p + query.dpdy.get(i), r + query.drdy.get(i)) - along,
                    angle: o.angle.map(|a| a.get(i)),
                    sblur: option(o.sblur, i, 0.0),
                    tblur: option(o.tblur, i, 0.0),
                    swidth: option(o.swidth, i, 1.0),
                    twidth: option(o.twidth, i, 1.0),
                    up,
                    quick,
                    first_channel: first_channel(o.firstchannel, i),
                    fill,
                };
                reader.environment(id, &lookup, &mut values[..wanted]);
            }
            None => values[wanted - 1] = 0.0,
        }
        store(out, i, &values[..wanted]);
    }
}

/// Returns the point where the line from `p` along `r` leaves the sphere around the origin. It is the direction in
/// which a map of that radius is seen from its centre. Returns `r` itself when the line misses the sphere.
fn on_sphere(p: Vec3, r: Vec3, radius: f32) -> Vec3 {
    let Some(d) = r.try_normalize() else { return r };
    let b = p.dot(d);
    let discriminant = b * b - (p.length_squared() - radius * radius);
    if discriminant < 0.0 {
        return r;
    }
    let far = -b + discriminant.sqrt();
    if far > 0.0 { p + d * far } else { r }
}

/// Answers `shadow ()` from a map, with the same value in all three channels. `draw` gives each lane the random
/// numbers of its samples. `bias` is added to its distance, in "common" units. `factor` is the attribute
/// "render:samples". A file that cannot be used gives no shadow.
pub fn shadow(
    reader: &mut TextureReader<'_>,
    query: &ShadowQuery<'_>,
    factor: f32,
    draw: &dyn Fn(u32) -> Draw,
    bias: &dyn Fn(usize) -> f32,
    out: &mut Lanes3,
) {
    fit(out, query.batch.lanes);
    let id = find(reader, query.name, query.handle, Use::Shadow);
    let o = &query.options;
    for &lane in query.batch.active {
        let i = lane as usize;
        let blocked = id.map_or(0.0, |id| {
            let lookup = ShadowLookup {
                p: query.p.get(i),
                dpdx: query.dpdx.get(i),
                dpdy: query.dpdy.get(i),
                sblur: option(o.sblur, i, 0.0),
                tblur: option(o.tblur, i, 0.0),
                swidth: option(o.swidth, i, 1.0),
                twidth: option(o.twidth, i, 1.0),
                samples: samples(count(o.samples, i), factor),
                bias: bias(i),
                draw: draw(lane),
            };
            reader.shadow(id, &lookup)
        });
        out.set(i, Vec3::splat(blocked));
    }
}

/// Allocates `lanes` triples.
pub(super) fn fit(out: &mut Lanes3, lanes: usize) {
    for c in &mut out.xyz {
        c.resize(lanes, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallax_directions_hit_the_sphere() {
        // From the centre, the direction is kept; off centre, it bends towards the near wall.
        let r = on_sphere(Vec3::ZERO, Vec3::X * 3.0, 2.0);
        assert!((r - Vec3::X * 2.0).length() < 1e-6);
        let r = on_sphere(Vec3::new(0.0, 1.0, 0.0), Vec3::X, 2.0);
        assert!((r - Vec3::new(3.0_f32.sqrt(), 1.0, 0.0)).length() < 1e-6);
        // The line starts outside and points away from the sphere, or misses it.
        assert_eq!(on_sphere(Vec3::X * 5.0, Vec3::X, 2.0), Vec3::X);
        assert_eq!(on_sphere(Vec3::Y * 5.0, Vec3::X, 2.0), Vec3::X);
        assert_eq!(on_sphere(Vec3::ZERO, Vec3::ZERO, 2.0), Vec3::ZERO);
    }
}
