//! Light indices, and sets of them.

use rpds::RedBlackTreeSetSync;

/// An index into [`Scene::lights`](crate::Scene::lights).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct LightId(pub u32);

/// The lights that illuminate an object, in the order of declaration. A copy shares its memory with the original,
/// like a copy of [`Values`](crate::Values).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSet(RedBlackTreeSetSync<LightId>);

impl LightSet {
    /// True when a light is in the set.
    pub fn contains(&self, light: LightId) -> bool {
        self.0.contains(&light)
    }

    /// Adds or removes a light.
    pub fn switch(&mut self, light: LightId, on: bool) {
        if on {
            self.0.insert_mut(light);
        } else {
            self.0.remove_mut(&light);
        }
    }

    /// Returns all lights, in the order of declaration.
    pub fn iter(&self) -> impl Iterator<Item = LightId> {
        self.0.iter().copied()
    }

    /// The number of lights.
    pub fn len(&self) -> usize {
        self.0.size()
    }

    /// True when there are no lights.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl FromIterator<LightId> for LightSet {
    fn from_iter<I: IntoIterator<Item = LightId>>(lights: I) -> Self {
        Self(lights.into_iter().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_iterated_in_order() {
        let mut lights: LightSet = [3, 1, 2].map(LightId).into_iter().collect();
        let before = lights.clone();
        lights.switch(LightId(0), true);
        lights.switch(LightId(2), false);
        lights.switch(LightId(7), false);
        assert_eq!(lights.iter().map(|l| l.0).collect::<Vec<_>>(), [0, 1, 3]);
        assert!(before.len() == 3 && before.contains(LightId(2)) && !lights.contains(LightId(2)));
        assert!(LightSet::default().is_empty());
    }
}
