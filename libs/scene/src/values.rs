//! Attributes by name, and lists of lights, of which states that differ in few share the others.

use crate::LightId;
use granita_base::Param;
use rpds::{RedBlackTreeMapSync, RedBlackTreeSetSync};
use std::sync::Arc;

/// Attributes by name, in the order of names. A copy shares its memory with the original: changing one attribute of a copy
/// costs as much as there are steps to it in a tree, however many attributes there are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values(RedBlackTreeMapSync<Arc<str>, Param>);

impl Values {
    /// The attribute of this name.
    pub fn get(&self, name: &str) -> Option<&Param> {
        self.0.get(name)
    }

    /// The attribute of this name, and the name as it is kept.
    pub fn get_key_value(&self, name: &str) -> Option<(&Arc<str>, &Param)> {
        self.0.get_key_value(name)
    }

    /// Sets an attribute.
    pub fn insert(&mut self, name: Arc<str>, value: Param) {
        self.0.insert_mut(name, value);
    }

    /// Takes an attribute out; whether it was there.
    pub fn remove(&mut self, name: &str) -> bool {
        self.0.remove_mut(name)
    }

    /// All of them, in the order of names.
    pub fn iter(&self) -> impl Iterator<Item = (&Arc<str>, &Param)> {
        self.0.iter()
    }

    /// Keeps those of which `keep` says so.
    pub fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        let gone: Vec<Arc<str>> = self.0.keys().filter(|name| !keep(name)).cloned().collect();
        gone.iter().for_each(|name| {
            self.0.remove_mut(name);
        });
    }
}

impl Extend<(Arc<str>, Param)> for Values {
    fn extend<I: IntoIterator<Item = (Arc<str>, Param)>>(&mut self, values: I) {
        values.into_iter().for_each(|(name, value)| self.insert(name, value));
    }
}

impl FromIterator<(Arc<str>, Param)> for Values {
    fn from_iter<I: IntoIterator<Item = (Arc<str>, Param)>>(values: I) -> Self {
        let mut all = Self::default();
        all.extend(values);
        all
    }
}

/// The lights that shine on an object, in the order of declaration. A copy shares its memory with the original, as that of
/// [`Values`] does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSet(RedBlackTreeSetSync<LightId>);

impl LightSet {
    /// Whether a light is among them.
    pub fn contains(&self, light: LightId) -> bool {
        self.0.contains(&light)
    }

    /// Adds a light or takes it out.
    pub fn switch(&mut self, light: LightId, on: bool) {
        if on {
            self.0.insert_mut(light);
        } else {
            self.0.remove_mut(&light);
        }
    }

    /// All of them, in the order of declaration.
    pub fn iter(&self) -> impl Iterator<Item = LightId> {
        self.0.iter().copied()
    }

    /// The number of lights.
    pub fn len(&self) -> usize {
        self.0.size()
    }

    /// Whether there is none.
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
    fn lights_are_in_order() {
        let mut lights: LightSet = [3, 1, 2].map(LightId).into_iter().collect();
        let before = lights.clone();
        lights.switch(LightId(0), true);
        lights.switch(LightId(2), false);
        lights.switch(LightId(7), false);
        assert_eq!(lights.iter().map(|l| l.0).collect::<Vec<_>>(), [0, 1, 3]);
        assert!(before.len() == 3 && before.contains(LightId(2)) && !lights.contains(LightId(2)));
        assert!(LightSet::default().is_empty());
    }

    fn param(name: &str) -> Param {
        Param::declared(name, 1.0).unwrap()
    }

    #[test]
    fn copies_differ_and_share() {
        let mut all = Values::default();
        let mut copies = Vec::new();
        for i in 0..1000 {
            all.insert(format!("user:a{i}").into(), param("float a"));
            copies.push(all.clone());
        }
        assert_eq!(copies[9].iter().count(), 10);
        assert_eq!(all.iter().count(), 1000);
        // What two neighbours have in common is one piece of memory.
        let shared = (0..999).filter(|i| {
            let name = format!("user:a{i}");
            let (a, b) = (copies[998].get(&name), all.get(&name));
            a.zip(b).is_some_and(|(a, b)| std::ptr::eq(a, b))
        });
        assert!(shared.count() > 950);
        assert!(all.remove("user:a3") && !all.remove("user:a3"));
        all.retain(|name| name.ends_with('7'));
        assert_eq!(all.iter().count(), 100);
        assert!(copies[999].get("user:a3").is_some());
    }
}
