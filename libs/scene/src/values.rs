//! Attributes by name. States that differ in few attributes share the others.

use granita_base::Param;
use rpds::RedBlackTreeMapSync;
use std::sync::Arc;

/// Attributes by name, in the order of names. A copy shares its memory with the original. Changing one attribute of a
/// copy costs the depth of a tree, whatever the number of attributes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values(RedBlackTreeMapSync<Arc<str>, Param>);

impl Values {
    /// Returns the attribute of this name.
    pub fn get(&self, name: &str) -> Option<&Param> {
        self.0.get(name)
    }

    /// Returns the attribute of this name, and the name as it is stored.
    pub fn get_key_value(&self, name: &str) -> Option<(&Arc<str>, &Param)> {
        self.0.get_key_value(name)
    }

    /// Sets an attribute.
    pub fn insert(&mut self, name: Arc<str>, value: Param) {
        self.0.insert_mut(name, value);
    }

    /// Removes an attribute. Returns whether it existed.
    pub fn remove(&mut self, name: &str) -> bool {
        self.0.remove_mut(name)
    }

    /// Returns all attributes, in the order of names.
    pub fn iter(&self) -> impl Iterator<Item = (&Arc<str>, &Param)> {
        self.0.iter()
    }

    /// Removes the attributes for which `keep` returns false.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn param(name: &str) -> Param {
        Param::declared(name, 1.0).unwrap()
    }

    #[test]
    fn copies_are_independent_and_share_memory() {
        let mut all = Values::default();
        let mut copies = Vec::new();
        for i in 0..1000 {
            all.insert(format!("user:a{i}").into(), param("float a"));
            copies.push(all.clone());
        }
        assert_eq!(copies[9].iter().count(), 10);
        assert_eq!(all.iter().count(), 1000);
        // The common part of two neighbours is stored once.
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
