//! Keys of answers: hashes of 128 bits of whole questions.

use foldhash::quality::FixedState;
use granita_shade::{Batch, Lane, Lane3, Lanes3, Primvar, PrimvarData};
use std::hash::{BuildHasher, Hasher};

/// The key of an answer.
pub(crate) type Key = [u64; 2];

/// Hashes the parts of a question. Two questions of one grid get the same key only when they are the same, except with
/// a probability of 2^-128.
pub(crate) struct KeyHasher([<FixedState as BuildHasher>::Hasher; 2]);

impl Default for KeyHasher {
    fn default() -> Self {
        Self(
            [0x9e37_79b9_7f4a_7c15, 0xd1b5_4a32_d192_ed03]
                .map(|seed| FixedState::with_seed(seed).build_hasher()),
        )
    }
}

impl KeyHasher {
    pub(crate) fn finish(&self) -> Key {
        self.0.each_ref().map(Hasher::finish)
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.0.iter_mut().for_each(|hasher| hasher.write(bytes));
    }

    pub(crate) fn word(&mut self, word: u32) {
        self.0.iter_mut().for_each(|hasher| hasher.write_u32(word));
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.word(text.len() as u32);
        self.bytes(text.as_bytes());
    }

    /// Adds numbers, to the bit.
    pub(crate) fn numbers(&mut self, numbers: &[f32]) {
        self.word(numbers.len() as u32);
        self.bytes(bytemuck::cast_slice(numbers));
    }

    /// Adds words.
    pub(crate) fn words(&mut self, words: &[u32]) {
        self.word(words.len() as u32);
        self.bytes(bytemuck::cast_slice(words));
    }

    /// Adds the values of the active lanes.
    pub(crate) fn lane(&mut self, lane: Lane<'_>, batch: Batch<'_>) {
        self.word(lane.stride as u32);
        if lane.stride == 0 {
            self.word(lane.values.first().map_or(0, |v| v.to_bits()));
        } else if batch.active.len() == batch.lanes && lane.values.len() >= batch.lanes && lane.stride == 1 {
            self.bytes(bytemuck::cast_slice(&lane.values[..batch.lanes]));
        } else {
            batch.active.iter().for_each(|i| self.word(lane.get(*i as usize).to_bits()));
        }
    }

    pub(crate) fn lane3(&mut self, lane: Lane3<'_>, batch: Batch<'_>) {
        lane.xyz.into_iter().for_each(|lane| self.lane(lane, batch));
    }

    pub(crate) fn lanes3(&mut self, lanes: &Lanes3) {
        lanes.xyz.iter().for_each(|values| self.numbers(values));
    }

    /// Adds the lanes themselves.
    pub(crate) fn batch(&mut self, batch: Batch<'_>) {
        self.word(batch.lanes as u32);
        self.word(batch.layer as u32);
        match batch.active.len() == batch.lanes {
            true => self.word(u32::MAX),
            false => self.words(batch.active),
        }
    }

    pub(crate) fn option(&mut self, lane: Option<Lane<'_>>, batch: Batch<'_>) {
        match lane {
            Some(lane) => self.lane(lane, batch),
            None => self.word(2),
        }
    }

    pub(crate) fn optional_text(&mut self, text: Option<&str>) {
        match text {
            Some(text) => self.text(text),
            None => self.word(u32::MAX),
        }
    }

    /// Adds messages or parameters.
    pub(crate) fn primvar(&mut self, value: &Primvar) {
        self.text(&value.name);
        self.word(value.ty.base as u32);
        self.word(value.ty.array.unwrap_or(u32::MAX));
        match &value.data {
            PrimvarData::Floats { values, varying } => {
                self.word(u32::from(*varying));
                self.numbers(values);
            }
            PrimvarData::Strings(list) => list.iter().for_each(|text| self.text(text)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_depend_on_active_lanes_only() {
        let key = |values: &[f32], active: &[u32]| {
            let mut hasher = KeyHasher::default();
            let batch = Batch { lanes: values.len(), active, layer: 0 };
            hasher.batch(batch);
            hasher.lane(Lane { values, stride: 1 }, batch);
            hasher.finish()
        };
        let all = [0, 1, 2];
        assert_eq!(key(&[1.0, 2.0, 3.0], &all), key(&[1.0, 2.0, 3.0], &all));
        assert_ne!(key(&[0.0, 2.0, 3.0], &all), key(&[-0.0, 2.0, 3.0], &all));
        assert_eq!(key(&[1.0, 2.0, 3.0], &[0, 2]), key(&[1.0, 5.0, 3.0], &[0, 2]));
        assert_ne!(key(&[1.0, 2.0, 3.0], &[0, 2]), key(&[1.0, 2.0, 3.0], &[0, 1]));
    }
}
