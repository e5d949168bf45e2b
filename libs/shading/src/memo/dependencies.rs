//! What results of shading depend on, and what changed between two frames.

use granita_scene::LightId;
use std::collections::BTreeSet;

/// Something that may change between two renders of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Dependency {
    /// A light: its shaders, their parameters, its place and its attributes.
    Light(LightId),
    /// Whether a light is ambient, and its categories.
    Kind(LightId),
    /// A file, by its number in the context.
    File(u32),
    /// The lights of an object, by the number of its state in the context.
    Object(u32),
}

/// A set of dependencies.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Dependencies(Vec<Dependency>);

impl Dependencies {
    /// Adds one.
    pub(crate) fn add(&mut self, one: Dependency) {
        if let Err(at) = self.0.binary_search(&one) {
            self.0.insert(at, one);
        }
    }

    /// Adds all of another set.
    pub(crate) fn add_all(&mut self, others: &Self) {
        others.0.iter().for_each(|one| self.add(*one));
    }

    /// Removes all but files.
    pub(crate) fn keep_files(&mut self) {
        self.0.retain(|one| matches!(one, Dependency::File(_)));
    }

    /// The bytes on the heap.
    pub(crate) fn bytes(&self) -> usize {
        self.0.capacity() * size_of::<Dependency>()
    }

    /// Frees memory that is not used.
    pub(crate) fn shrink(&mut self) {
        self.0.shrink_to_fit();
    }
}

impl FromIterator<Dependency> for Dependencies {
    fn from_iter<I: IntoIterator<Item = Dependency>>(list: I) -> Self {
        let mut all = Self::default();
        list.into_iter().for_each(|one| all.add(one));
        all
    }
}

/// What changed since the last frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes(BTreeSet<Dependency>);

impl Changes {
    /// True when nothing changed.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds a change.
    pub(crate) fn add(&mut self, one: Dependency) {
        self.0.insert(one);
    }

    /// True when one of them is among the dependencies.
    pub(crate) fn touch(&self, depends: &Dependencies) -> bool {
        !self.0.is_empty() && depends.0.iter().any(|one| self.0.contains(one))
    }

    /// Returns the numbers of lights, files and objects that changed.
    pub fn counts(&self) -> [usize; 3] {
        let mut counts = [0; 3];
        for one in &self.0 {
            counts[match one {
                Dependency::Light(_) => 0,
                Dependency::File(_) => 1,
                Dependency::Object(_) => 2,
                // Its light changed as well.
                Dependency::Kind(_) => continue,
            }] += 1;
        }
        counts
    }
}

impl Changes {
    /// Returns these changes.
    #[cfg(test)]
    pub(crate) fn of(list: &[Dependency]) -> Self {
        Self(list.iter().copied().collect())
    }
}
