//! For the tests of the figures: does the text fit?

use resvg::usvg::{Group, Node, Rect, Tree};

use super::fonts;

/// Every text lies on the sheet, and no two upright or two turned texts lie on each other.
pub(super) fn assert_all_text_fits(svg: &str) {
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    let tree = Tree::from_str(svg, &fonts::options()).unwrap();
    let mut boxes = Vec::new();
    collect(tree.root(), &mut boxes);
    assert!(!boxes.is_empty());
    for (text, area) in &boxes {
        let is_inside = area.left() >= 0.0
            && area.top() >= 0.0
            && area.right() <= tree.size().width()
            && area.bottom() <= tree.size().height();
        assert!(is_inside, "`{text}` at {area:?} leaves the sheet {:?}", tree.size());
    }
    for (index, (text, area)) in boxes.iter().enumerate() {
        for (other_text, other) in &boxes[index + 1..] {
            assert!(
                !overlap(area, other),
                "`{text}` {area:?} and `{other_text}` {other:?} overlap"
            );
        }
    }
}

/// Writes a figure for a person to look at, to the folder named by `$FIGURES`.
pub(super) fn write_sample(name: &str, svg: &str) {
    let folder = std::env::var_os("FIGURES").expect("set FIGURES to a folder");
    super::write_figure(&std::path::Path::new(&folder).join(name), svg).unwrap();
}

/// The box of a text holds the room above and below its letters; a fifth of it is no collision. Sloping text is left
/// out, because its box says little.
fn overlap(one: &Rect, two: &Rect) -> bool {
    let across = one.right().min(two.right()) - one.left().max(two.left());
    let down = one.bottom().min(two.bottom()) - one.top().max(two.top());
    across > 0.0 && down > 0.2 * one.height().min(two.height())
}

fn collect(group: &Group, boxes: &mut Vec<(String, Rect)>) {
    for node in group.children() {
        match node {
            Node::Text(text) => {
                let content: String =
                    text.chunks().iter().map(resvg::usvg::TextChunk::text).collect();
                let transform = text.abs_transform();
                let is_sloping = transform.kx.abs() > 0.01 && transform.sx.abs() > 0.01;
                let area = text.abs_bounding_box();
                if is_sloping {
                    assert!(
                        area.left() >= 0.0 && area.top() >= 0.0,
                        "`{content}` leaves the sheet"
                    );
                } else {
                    boxes.push((content, area));
                }
            }
            Node::Group(group) => collect(group, boxes),
            _ => {}
        }
    }
}
