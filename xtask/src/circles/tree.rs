//! Reads the modules of one crate: the names of each module, where these are defined, and the names that its code
//! mentions.

use proc_macro2::{TokenStream, TokenTree};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syn::spanned::Spanned;
use syn::visit::Visit;

/// The index of a module in [`Tree::modules`].
pub(super) type ModuleId = usize;

/// The largest number of imports of imports that are followed. More of them are a loop.
const MAX_IMPORTS: usize = 32;

/// A function that returns the text of a file.
pub(super) type Reader<'a> = &'a dyn Fn(&Path) -> Option<String>;

/// A module, in its own file or in that of its parent.
pub(super) struct Module {
    /// The file that contains its code.
    pub(super) file: PathBuf,
    /// The parent; `None` for the root of the crate.
    pub(super) parent: Option<ModuleId>,
    /// All names of its scope. One name can be a module, a type and a function.
    names: BTreeMap<String, Vec<Name>>,
    /// The paths of `use path::*`.
    globs: Vec<Vec<String>>,
    /// True when macros may define more names.
    is_open: bool,
    /// All paths of its code outside of tests.
    pub(super) mentions: Vec<Mention>,
}

/// The meaning of a name of a module.
enum Name {
    /// A child module.
    Module(ModuleId),
    /// An item that the module defines.
    Item,
    /// An item or module that `use` imports from this path.
    Import(Vec<String>),
}

/// A path in the code.
#[derive(PartialEq, Eq)]
pub(super) struct Mention {
    /// The segments, such as `["crate", "dice", "Dice"]`.
    pub(super) path: Vec<String>,
    /// The line, counted from 1.
    pub(super) line: usize,
}

/// The result of following a path.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Target {
    /// This module itself.
    Module(ModuleId),
    /// An item that this module defines.
    Item(ModuleId),
}

/// All modules of a crate. The first one is its root.
pub(super) struct Tree {
    pub(super) modules: Vec<Module>,
}

impl Tree {
    /// Reads the crate with this root file.
    ///
    /// # Errors
    /// Returns the path of a file that is missing or is not Rust, with the reason.
    pub(super) fn read(root: &Path, reader: Reader) -> Result<Self, String> {
        let mut tree = Self { modules: Vec::new() };
        let folder = root.parent().unwrap_or(Path::new("")).to_owned();
        tree.read_file(root, &folder, None, reader)?;
        Ok(tree)
    }

    /// True when `outer` is `inner` or contains it.
    pub(super) fn contains(&self, outer: ModuleId, inner: ModuleId) -> bool {
        std::iter::successors(Some(inner), |m| self.modules[*m].parent).any(|m| m == outer)
    }

    /// Returns the outermost module of the file that contains this module.
    pub(super) fn file_module(&self, module: ModuleId) -> ModuleId {
        let file = &self.modules[module].file;
        std::iter::successors(Some(module), |m| self.modules[*m].parent)
            .take_while(|m| self.modules[*m].file == *file)
            .last()
            .unwrap_or(module)
    }

    /// Returns the target of a path of this module; `None` outside of this crate.
    pub(super) fn resolve(&self, path: &[String], module: ModuleId) -> Option<Target> {
        self.follow(path, module, 0)
    }

    /// True when a path starts with an item that a `use` line of the module has already mentioned.
    pub(super) fn is_imported(&self, mention: &Mention, module: ModuleId) -> bool {
        let names = mention.path.first().and_then(|name| self.modules[module].names.get(name));
        names.into_iter().flatten().any(|name| match name {
            Name::Import(path) => {
                *path != mention.path && matches!(self.resolve(path, module), Some(Target::Item(_)))
            }
            _ => false,
        })
    }

    fn follow(&self, path: &[String], module: ModuleId, depth: usize) -> Option<Target> {
        let mut at = Target::Module(module);
        for (i, segment) in path.iter().enumerate() {
            let Target::Module(here) = at else { return Some(at) };
            at = match segment.as_str() {
                "crate" if i == 0 => Target::Module(0),
                "self" if i == 0 => Target::Module(here),
                "super" => Target::Module(self.modules[here].parent?),
                name => match self.look_up(name, i + 1 == path.len(), here, depth + 1) {
                    Some(found) => found,
                    None if i > 0 && self.modules[here].is_open => Target::Item(here),
                    None => return None,
                },
            };
        }
        Some(at)
    }

    /// Returns the meaning of a name in a module. An item is preferred for the last name of a path, and a module for
    /// all others.
    fn look_up(&self, name: &str, last: bool, module: ModuleId, depth: usize) -> Option<Target> {
        if depth > MAX_IMPORTS {
            return None;
        }
        let here = &self.modules[module];
        let named = here.names.get(name).map_or(&[][..], Vec::as_slice).iter();
        let mut found: Vec<Target> = named
            .filter_map(|name| match name {
                Name::Module(child) => Some(Target::Module(*child)),
                Name::Item => Some(Target::Item(module)),
                Name::Import(path) => self.follow(path, module, depth),
            })
            .collect();
        if found.is_empty() {
            let modules = here.globs.iter().filter_map(|path| self.follow(path, module, depth));
            found.extend(modules.filter_map(|target| match target {
                Target::Module(from) if from != module => self.look_up(name, last, from, depth + 1),
                _ => None,
            }));
        }
        let item = |target: &&Target| matches!(target, Target::Item(_)) == last;
        found.iter().find(item).or(found.first()).copied()
    }

    /// Reads a file and the modules below it, which lie in `folder`.
    fn read_file(
        &mut self,
        file: &Path,
        folder: &Path,
        parent: Option<ModuleId>,
        reader: Reader,
    ) -> Result<ModuleId, String> {
        let text = reader(file).ok_or_else(|| format!("{}: cannot be read", file.display()))?;
        let parsed = syn::parse_file(&text)
            .map_err(|e| format!("{}:{}: {e}", file.display(), e.span().start().line))?;
        self.read_items(&parsed.items, Place { file, folder, parent }, reader)
    }

    fn read_items(&mut self, items: &[syn::Item], place: Place, reader: Reader) -> Result<ModuleId, String> {
        let id = self.modules.len();
        let mut collector = Collector::default();
        items.iter().for_each(|item| collector.visit_item(item));
        let Collector { mentions, imports, globs } = collector;
        let mut names: BTreeMap<String, Vec<Name>> = BTreeMap::new();
        for (name, path) in imports {
            names.entry(name).or_default().push(Name::Import(path));
        }
        for name in items.iter().filter(|item| !for_tests(attributes(item))).filter_map(item_name) {
            names.entry(name).or_default().push(Name::Item);
        }
        self.modules.push(Module {
            file: place.file.to_owned(),
            parent: place.parent,
            names,
            globs,
            is_open: items.iter().any(|item| matches!(item, syn::Item::Macro(m) if m.ident.is_none())),
            mentions,
        });
        for item in items {
            if let syn::Item::Mod(module) = item
                && !for_tests(&module.attrs)
            {
                let child = self.read_child(module, id, &place, reader)?;
                let name = module.ident.to_string();
                self.modules[id].names.entry(name).or_default().push(Name::Module(child));
            }
        }
        Ok(id)
    }

    fn read_child(
        &mut self,
        module: &syn::ItemMod,
        parent: ModuleId,
        place: &Place,
        reader: Reader,
    ) -> Result<ModuleId, String> {
        let name = module.ident.to_string();
        let below = place.folder.join(&name);
        if let Some((_, items)) = &module.content {
            return self.read_items(
                items,
                Place { file: place.file, folder: &below, parent: Some(parent) },
                reader,
            );
        }
        if let Some(path) = path_attribute(&module.attrs) {
            let file = normal(&place.file.parent().unwrap_or(Path::new("")).join(path));
            let folder = file.parent().unwrap_or(Path::new("")).to_owned();
            return self.read_file(&file, &folder, Some(parent), reader);
        }
        let beside = place.folder.join(format!("{name}.rs"));
        let file = if reader(&beside).is_some() { beside } else { below.join("mod.rs") };
        self.read_file(&file, &below, Some(parent), reader)
    }
}

/// The location of a module.
struct Place<'a> {
    file: &'a Path,
    /// The folder of its child modules.
    folder: &'a Path,
    parent: Option<ModuleId>,
}

/// Visits the code of one module without tests and inner modules.
#[derive(Default)]
struct Collector {
    mentions: Vec<Mention>,
    imports: Vec<(String, Vec<String>)>,
    globs: Vec<Vec<String>>,
}

impl Collector {
    fn mention(&mut self, path: Vec<String>, line: usize) {
        let mention = Mention { path, line };
        if !self.mentions.contains(&mention) {
            self.mentions.push(mention);
        }
    }

    fn use_tree(&mut self, tree: &syn::UseTree, mut path: Vec<String>) {
        let line = tree.span().start().line;
        match tree {
            syn::UseTree::Path(part) => {
                path.push(part.ident.to_string());
                self.use_tree(&part.tree, path);
            }
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|tree| self.use_tree(tree, path.clone()));
            }
            syn::UseTree::Glob(_) => self.globs.push(path),
            syn::UseTree::Name(leaf) => self.import(leaf.ident.to_string(), None, path, line),
            syn::UseTree::Rename(leaf) => {
                self.import(leaf.ident.to_string(), Some(leaf.rename.to_string()), path, line);
            }
        }
    }

    fn import(&mut self, name: String, rename: Option<String>, mut path: Vec<String>, line: usize) {
        let own = if name == "self" { path.last().cloned().unwrap_or_default() } else { name.clone() };
        if name != "self" {
            path.push(name);
        }
        self.imports.push((rename.unwrap_or(own), path.clone()));
        self.mention(path, line);
    }

    /// Collects paths in the tokens of macros, which are not expanded. Any sequence of tokens that looks like a path
    /// counts.
    fn tokens(&mut self, tokens: TokenStream) {
        let mut path: Vec<String> = Vec::new();
        let mut line = 0;
        let mut colons = 0;
        for token in tokens {
            match token {
                TokenTree::Ident(name) if colons == 2 && !path.is_empty() => path.push(name.to_string()),
                TokenTree::Ident(name) => {
                    self.end_of_path(&mut path, line);
                    line = name.span().start().line;
                    path.push(name.to_string());
                }
                TokenTree::Punct(mark) if mark.as_char() == ':' => {
                    colons += 1;
                    continue;
                }
                TokenTree::Group(group) => {
                    self.end_of_path(&mut path, line);
                    self.tokens(group.stream());
                }
                _ => self.end_of_path(&mut path, line),
            }
            colons = 0;
        }
        self.end_of_path(&mut path, line);
    }

    fn end_of_path(&mut self, path: &mut Vec<String>, line: usize) {
        if !path.is_empty() {
            self.mention(std::mem::take(path), line);
        }
    }
}

impl<'ast> Visit<'ast> for Collector {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !for_tests(attributes(item)) && !matches!(item, syn::Item::Mod(_)) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        if !for_tests(&function.attrs) {
            syn::visit::visit_impl_item_fn(self, function);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if item.leading_colon.is_none() {
            self.use_tree(&item.tree, Vec::new());
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() {
            let names = path.segments.iter().map(|s| s.ident.to_string()).collect();
            self.mention(names, path.span().start().line);
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, invocation: &'ast syn::Macro) {
        self.visit_path(&invocation.path);
        self.tokens(invocation.tokens.clone());
    }

    // The path in `pub(in crate::a)` does not name an item.
    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
}

fn item_name(item: &syn::Item) -> Option<String> {
    let name = match item {
        syn::Item::Const(item) => &item.ident,
        syn::Item::Enum(item) => &item.ident,
        syn::Item::Fn(item) => &item.sig.ident,
        syn::Item::Macro(item) => item.ident.as_ref()?,
        syn::Item::Static(item) => &item.ident,
        syn::Item::Struct(item) => &item.ident,
        syn::Item::Trait(item) => &item.ident,
        syn::Item::TraitAlias(item) => &item.ident,
        syn::Item::Type(item) => &item.ident,
        syn::Item::Union(item) => &item.ident,
        _ => return None,
    };
    Some(name.to_string())
}

fn attributes(item: &syn::Item) -> &[syn::Attribute] {
    match item {
        syn::Item::Const(item) => &item.attrs,
        syn::Item::Enum(item) => &item.attrs,
        syn::Item::Fn(item) => &item.attrs,
        syn::Item::Impl(item) => &item.attrs,
        syn::Item::Macro(item) => &item.attrs,
        syn::Item::Mod(item) => &item.attrs,
        syn::Item::Static(item) => &item.attrs,
        syn::Item::Struct(item) => &item.attrs,
        syn::Item::Trait(item) => &item.attrs,
        syn::Item::Type(item) => &item.attrs,
        syn::Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// True when code exists in tests only: `#[test]`, `#[cfg(test)]`, `#[cfg(all(test, ...))]`.
fn for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        syn::Meta::Path(path) => path.is_ident("test"),
        syn::Meta::List(list) if list.path.is_ident("cfg") => {
            let condition: String = list.tokens.to_string().chars().filter(|c| !c.is_whitespace()).collect();
            condition == "test" || condition.starts_with("all(test,")
        }
        _ => false,
    })
}

/// Returns the file of `#[path = "..."]`.
fn path_attribute(attributes: &[syn::Attribute]) -> Option<String> {
    attributes.iter().find_map(|attribute| match &attribute.meta {
        syn::Meta::NameValue(pair) if pair.path.is_ident("path") => match &pair.value {
            syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) => Some(text.value()),
            _ => None,
        },
        _ => None,
    })
}

/// Returns the path without `..`.
fn normal(path: &Path) -> PathBuf {
    let mut result = PathBuf::new();
    for part in path.components() {
        if part == std::path::Component::ParentDir {
            result.pop();
        } else {
            result.push(part);
        }
    }
    result
}
