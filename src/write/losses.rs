//! What a result no longer has of the materials and textures of its input.

use std::collections::BTreeSet;
use std::path::Path;

use super::numbering::Usage;
use crate::base::error::escape;
use crate::base::{Findings, counted};
use crate::model::catalogue::MaterialDefinition;
use crate::model::id::{MaterialId, NameId};
use crate::model::{Catalogue, Material};

/// Materials of the faces of the result.
pub(super) fn used_materials(catalogue: &Catalogue, usage: &Usage) -> BTreeSet<MaterialId> {
    let parts = catalogue.parts.iter().zip(&usage.faces_per_part).filter(|&(_, &faces)| faces > 0);
    parts.filter_map(|(part, _)| part.material).collect()
}

/// Reports the materials and textures that no face of the result uses any more.
pub(super) fn note_losses(catalogue: &Catalogue, usage: &Usage, findings: &mut Findings) {
    let used = used_materials(catalogue, usage);
    let all = catalogue.materials.keys();
    let lost = all.clone().filter(|material| !used.contains(material));
    let lost = lost.map(|material| &catalogue.materials[material].output_name[..]).collect();
    note_lost("lost_materials", "material", all.len(), lost, findings);

    let (before, left) = (textures(catalogue, all), textures(catalogue, used.iter().copied()));
    let lost = before.difference(&left).map(|(_, name)| *name).collect();
    note_lost("lost_textures", "texture", before.len(), lost, findings);
}

/// Textures of some materials: the folder of the MTL, and the name in it.
fn textures(catalogue: &Catalogue, materials: impl Iterator<Item = MaterialId>) -> BTreeSet<(&Path, &[u8])> {
    let definitions = materials.filter_map(|material| catalogue.materials[material].definition.as_ref());
    definitions.flat_map(|d| d.textures.iter().map(|texture| (d.folder.as_path(), &texture.name[..]))).collect()
}

/// Number of textures that the materials of the input name.
pub fn texture_count(catalogue: &Catalogue) -> u64 {
    textures(catalogue, catalogue.materials.keys()).len() as u64
}

/// Notes each lost item; the first note also says how many of `total` are left.
fn note_lost(kind: &'static str, what: &str, total: usize, lost: Vec<&[u8]>, findings: &mut Findings) {
    let left = format!("{} of {} left; ", total - lost.len(), counted(total as u64, what));
    for (place, name) in lost.into_iter().enumerate() {
        let left = if place == 0 { left.as_str() } else { "" };
        findings.note(kind, || format!("{left}'{}' is on no face of the result", escape(name)));
    }
}

/// Reports what of objects, groups and materials a format cannot hold; `written` counts the statements of a material
/// that it holds.
pub(super) fn note_unwritten(
    catalogue: &Catalogue,
    usage: &Usage,
    format: &str,
    findings: &mut Findings,
    written: impl Fn(&MaterialDefinition) -> usize,
) {
    let parts = catalogue.parts.iter().zip(&usage.faces_per_part).filter(|&(_, &faces)| faces > 0);
    let names: BTreeSet<NameId> = parts.flat_map(|(part, _)| [part.object, part.group]).flatten().collect();
    for name in names {
        let name = escape(&catalogue.names[name]);
        findings.note("unwritten_names", || format!("'{name}' is not written: a {format} has no objects and groups"));
    }
    for material in used_materials(catalogue, usage) {
        let Material { output_name, definition, .. } = &catalogue.materials[material];
        let Some(definition) = definition else { continue };
        match (definition.statements.len() + definition.textures.len() - written(definition)) as u64 {
            0 => {}
            count => findings.note("unwritten_statements", || {
                format!(
                    "{} of '{}' not written: a {format} has no place for them",
                    counted(count, "statement"),
                    escape(output_name)
                )
            }),
        }
    }
}
