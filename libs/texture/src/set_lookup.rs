//! Lookups of `texture ()`, in one texture or in a set of them.
//!
//! In a set, a footprint that leaves its square is continued in the neighbours. Each texture is looked up as if black
//! surrounded it, and the results are added. Since the weights of a footprint sum to 1, so do those of the parts. Where
//! a set has no neighbour, the texels of the border continue.

use crate::TextureId;
use crate::file::TextureFile;
use crate::lookup::Lookup;
use crate::plain::{by_channels, reach, texture};
use crate::reader::TextureReader;
use crate::squares::Squares;
use crate::wrap::Wrap;

impl TextureReader<'_> {
    /// Implements [`TextureCache::texture`](crate::TextureCache::texture).
    pub fn texture(&mut self, id: TextureId, lookup: &Lookup, out: &mut [f32]) {
        let file = self.look_up(id);
        match &file.set {
            Some(squares) => texture_of_set(self, file, squares, lookup, out),
            None => texture(self, file, lookup, out),
        }
    }
}

/// Returns -1 or 1 when a footprint that reaches this far leaves its square on this side, and 0 when it does not
/// leave it or when it leaves it on both sides.
fn side(x: f32, reach: f32) -> i64 {
    match (x < reach, x > 1.0 - reach) {
        (true, false) => -1,
        (false, true) => 1,
        _ => 0,
    }
}

/// Looks up a point in a set. `first` is the file of the first square.
fn texture_of_set(
    reader: &mut TextureReader<'_>,
    first: &TextureFile,
    squares: &Squares,
    q: &Lookup,
    out: &mut [f32],
) {
    let shared = reader.shared();
    let home = squares.home(q.s, q.t);
    let file = |place| shared.files.get(squares.index(place, |name| shared.find(name))?);
    let Some((home, own)) = home.and_then(|home| Some((home, file(home)?))) else {
        if let Some(what) = home.and_then(|home| squares.complaint(home)) {
            shared.warn(what);
        }
        return by_channels(first, q.first_channel, q.fill, out, |_, _| [0.0; 4]);
    };
    let (across, down) = reach(own, q);
    let (across, down) = (side(home.s, across), side(home.t, down));
    let neighbour = |columns, rows| {
        let place = home.from(columns, rows);
        file(place).map(|file| (place, file))
    };
    let beside = |down: i64| (across != 0).then(|| neighbour(across, down)).flatten();
    let next = (down != 0).then(|| neighbour(0, down)).flatten();
    let twrap = if next.is_some() { Wrap::Black } else { Wrap::Clamp };
    let mut is_first = true;
    for (place, file, down) in
        [Some((home, own, 0)), next.map(|(place, file)| (place, file, down))].into_iter().flatten()
    {
        let beside = beside(down);
        let swrap = if beside.is_some() { Wrap::Black } else { Wrap::Clamp };
        for (place, file) in [Some((place, file)), beside].into_iter().flatten() {
            let here = Lookup { s: place.s, t: place.t, swrap: Some(swrap), twrap: Some(twrap), ..*q };
            if std::mem::take(&mut is_first) {
                texture(reader, file, &here, out);
            } else {
                add(reader, file, &here, out);
            }
        }
    }
}

/// Looks up a point and adds its value. Channels that the file does not have stay as they are.
fn add(reader: &mut TextureReader<'_>, file: &TextureFile, q: &Lookup, out: &mut [f32]) {
    let mut first_channel = q.first_channel;
    for run in out.chunks_mut(4) {
        let mut part = [0.0; 4];
        texture(reader, file, &Lookup { first_channel, fill: 0.0, ..*q }, &mut part[..run.len()]);
        run.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        first_channel = first_channel.saturating_add(4);
    }
}
