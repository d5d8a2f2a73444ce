//! The topological order of stages. Among ready stages the order of the file is kept, so that a pipeline always runs in
//! the same order.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Orders the nodes `0..needs.len()`, where node `i` needs the nodes `needs[i]`.
///
/// # Errors
/// The nodes of a cycle, each needing the next and the last the first, if there is one.
pub fn order(needs: &[Vec<usize>]) -> Result<Vec<usize>, Vec<usize>> {
    let mut users = vec![Vec::new(); needs.len()];
    let mut open: Vec<usize> = needs.iter().map(Vec::len).collect();
    for (node, own) in needs.iter().enumerate() {
        own.iter().for_each(|&need| users[need].push(node));
    }
    let without = (0..needs.len()).filter(|&node| open[node] == 0);
    let mut ready: BinaryHeap<Reverse<usize>> = without.map(Reverse).collect();
    let mut placed = vec![false; needs.len()];
    let mut out = Vec::with_capacity(needs.len());
    while let Some(Reverse(next)) = ready.pop() {
        placed[next] = true;
        out.push(next);
        for &user in &users[next] {
            open[user] -= 1;
            if open[user] == 0 {
                ready.push(Reverse(user));
            }
        }
    }
    match out.len() == needs.len() {
        true => Ok(out),
        false => Err(cycle(needs, &placed)),
    }
}

/// Finds a cycle: every node that is not placed needs another such node, so following them leads into one.
fn cycle(needs: &[Vec<usize>], placed: &[bool]) -> Vec<usize> {
    let mut path: Vec<usize> = Vec::new();
    let mut at = placed.iter().position(|done| !done);
    while let Some(node) = at {
        if let Some(start) = path.iter().position(|&seen| seen == node) {
            return path.split_off(start);
        }
        path.push(node);
        at = needs[node].iter().copied().find(|&n| !placed[n]);
    }
    path
}

/// Returns nodes and everything that they need, in the order of `needs`, which must be topological.
pub fn closure(needs: &[&[usize]], targets: &[usize]) -> Vec<usize> {
    let mut included = vec![false; needs.len()];
    targets.iter().for_each(|&target| included[target] = true);
    for node in (0..needs.len()).rev() {
        if included[node] {
            needs[node].iter().for_each(|&n| included[n] = true);
        }
    }
    (0..needs.len()).filter(|&node| included[node]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn needs_come_first_and_the_file_decides_the_rest() {
        assert_eq!(order(&[vec![], vec![3], vec![], vec![0, 2]]), Ok(vec![0, 2, 3, 1]));
        assert_eq!(order(&[]), Ok(vec![]));
    }

    #[test]
    fn a_cycle_is_named_without_what_leads_into_it() {
        // 0 → 1 → 2 → 3 → 1, and 4 stands apart.
        assert_eq!(order(&[vec![1], vec![2], vec![3], vec![1], vec![]]), Err(vec![1, 2, 3]));
        assert_eq!(order(&[vec![0]]), Err(vec![0]));
    }

    #[test]
    fn the_closure_leaves_out_what_is_not_needed() {
        assert_eq!(closure(&[&[], &[], &[0], &[1], &[2]], &[2]), [0, 2]);
        assert_eq!(closure(&[&[], &[], &[0], &[1], &[2]], &[2, 3]), [0, 1, 2, 3]);
    }
}
