//! What the index is believed in, and above all what it is not.

use std::path::PathBuf;
use std::time::Duration;

use super::super::index::{self, Entries, Entry};
use super::super::stamp::{Stamp, machine_time};
use super::*;

fn index_path(store: &Store) -> PathBuf {
    store.root().join("index")
}

fn indexed(store: &Store) -> Entries {
    index::read(&index_path(store), machine_time())
}

fn stamp_of(path: &Path) -> Stamp {
    Stamp::of(&fs::metadata(path).unwrap())
}

/// As another process would find it.
fn looked_at(store: &Store, digest: &ArtifactId) -> Condition {
    let store = Store::open(store.root()).unwrap();
    store.inspect(digest, Effort::Quick).unwrap()
}

fn is_damaged(store: &Store, digest: &ArtifactId) -> bool {
    matches!(looked_at(store, digest), Condition::Damaged(_))
}

fn is_intact(store: &Store, digest: &ArtifactId) -> bool {
    matches!(looked_at(store, digest), Condition::Intact { .. })
}

/// A store with one artifact that its index knows.
fn known() -> (TempDir, Store, ArtifactId) {
    let (folder, store) = store();
    let digest = put(&store, &chunk(1, 20));
    store.save_index();
    (folder, store, digest)
}

/// Loses a bit without leaving a trace in any time.
fn flip_beneath(store: &Store, digest: &ArtifactId) {
    flip(&object_path(store, digest), 700);
    store.trust_current_file(digest);
}

#[test]
fn the_index_knows_what_was_put() {
    let (_folder, store, digest) = known();
    let entry = &indexed(&store)[&digest];
    assert_eq!(entry.stamp, stamp_of(&object_path(&store, &digest)));
    assert!(entry.stamp.is_settled(entry.noted), "noted once its tick was over");
    let manifest = put(&store, &Object::manifest(Default::default(), vec![digest]));
    store.save_index();
    let structure = indexed(&store)[&manifest].structure.clone().unwrap();
    assert_eq!((*structure.parts).as_slice(), [digest]);
    assert_eq!(
        indexed(&store)[&digest].structure.as_ref().unwrap().listing.kind,
        "count"
    );
}

#[test]
fn a_glance_reads_no_file_that_the_index_knows_and_all_else_does() {
    let (_folder, store, digest) = known();
    flip_beneath(&store, &digest);
    assert!(is_intact(&store, &digest), "it was not read");
    let reopened = || Store::open(store.root()).unwrap();
    let thorough = reopened().inspect(&digest, Effort::Thorough).unwrap();
    assert!(matches!(thorough, Condition::Damaged(_)));
    let reader = reopened();
    assert!(reader.artifact(&digest).err().unwrap().is_damage());
    let after = reader.inspect(&digest, Effort::Quick).unwrap();
    assert!(
        matches!(after, Condition::Damaged(_)),
        "once read, it is believed no more"
    );
    let distrustful = reopened().without_index().inspect(&digest, Effort::Quick).unwrap();
    assert!(matches!(distrustful, Condition::Damaged(_)));
    assert_eq!(reopened().fsck(&|_, _| ()).unwrap().damaged.len(), 1);
}

#[test]
fn altered_bytes_are_found_whatever_their_times_say() {
    let (_folder, store, digest) = known();
    let path = object_path(&store, &digest);
    let written = fs::metadata(&path).unwrap().modified().unwrap();
    flip(&path, 700);
    let file = fs::File::options().write(true).open(&path).unwrap();
    file.set_modified(written).unwrap();
    assert_eq!(stamp_of(&path).modified, indexed(&store)[&digest].stamp.modified);
    assert!(is_damaged(&store, &digest));
}

#[test]
fn an_index_that_is_not_whole_is_quietly_made_anew() {
    let (_folder, store, sound) = known();
    let broken = put(&store, &chunk(2, 20));
    store.save_index();
    flip_beneath(&store, &broken);
    let path = index_path(&store);
    let whole = fs::read(&path).unwrap();
    let other_version = || {
        let mut bytes = whole[..whole.len() - 32].to_vec();
        bytes[14] = b'1';
        let trailer = Digest::of(&bytes);
        bytes.extend(trailer.as_bytes());
        bytes
    };
    let damages: [&dyn Fn(); 6] = [
        &|| fs::remove_file(&path).unwrap(),
        &|| fs::write(&path, &whole[..whole.len() / 2]).unwrap(),
        &|| fs::write(&path, [0xff; 5000]).unwrap(),
        &|| fs::write(&path, []).unwrap(),
        &|| fs::write(&path, other_version()).unwrap(),
        &|| {
            fs::remove_file(&path).unwrap();
            fs::create_dir(&path).unwrap();
            fs::write(path.join("file"), "").unwrap();
        },
    ];
    for (i, damage) in damages.iter().enumerate() {
        damage();
        assert!(indexed(&store).is_empty(), "{i}");
        assert!(is_damaged(&store, &broken), "{i}: it was read");
        let another = Store::open(store.root()).unwrap();
        assert!(matches!(
            another.inspect(&sound, Effort::Quick).unwrap(),
            Condition::Intact { .. }
        ));
        another.save_index();
        assert_eq!(indexed(&store).keys().collect::<Vec<_>>(), [&sound], "{i}");
    }
    let aside = fs::read_dir(store.root().join("quarantine")).unwrap().count();
    assert_eq!(aside, 1, "the folder was moved aside with what was in it");
}

#[test]
fn entries_that_lie_about_a_stamp_are_not_believed() {
    let (_folder, store, digest) = known();
    flip_beneath(&store, &digest);
    let truth = indexed(&store)[&digest].clone();
    let lies: [&dyn Fn(&mut Stamp); 6] = [
        &|stamp| stamp.size += 1,
        &|stamp| stamp.modified.0 -= 1,
        &|stamp| stamp.modified.1 ^= 1,
        &|stamp| stamp.changed.0 -= 1,
        &|stamp| stamp.changed.1 ^= 1,
        &|stamp| stamp.inode += 1,
    ];
    let say = |entry: Entry| fs::write(index_path(&store), index::write(&[(digest, entry)].into())).unwrap();
    for (i, lie) in lies.iter().enumerate() {
        let mut entry = truth.clone();
        lie(&mut entry.stamp);
        say(entry);
        assert!(is_damaged(&store, &digest), "{i}");
    }
    say(truth.clone());
    assert!(
        is_intact(&store, &digest),
        "the control: each lie alone made the difference"
    );
    // A stamp taken within the tick of the last change, and one from a future that a clock has come back from.
    for noted in [truth.stamp.changed, (truth.noted.0 + 3600, 0)] {
        say(Entry { noted, ..truth.clone() });
        assert!(is_damaged(&store, &digest), "{noted:?}");
    }
}

#[test]
fn a_copied_store_is_verified_anew_and_a_moved_one_is_known() {
    let (folder, store, digest) = known();
    let other = put(&store, &chunk(2, 20));
    store.save_index();
    let (root, copy) = (store.root().to_owned(), folder.path().join("copy"));
    let copied = std::process::Command::new("cp").arg("-a").args([&root, &copy]).status();
    assert!(copied.unwrap().success());
    let copy = Store::open(&copy).unwrap();
    let path = object_path(&copy, &digest);
    let written = fs::metadata(&path).unwrap().modified().unwrap();
    flip(&path, 700);
    let file = fs::File::options().write(true).open(&path).unwrap();
    file.set_modified(written).unwrap();
    assert!(is_damaged(&copy, &digest));
    assert!(is_intact(&copy, &other));

    flip_beneath(&store, &digest);
    drop(store);
    let moved = folder.path().join("moved");
    fs::rename(&root, &moved).unwrap();
    assert!(is_intact(&Store::open(&moved).unwrap(), &digest), "it was not read");
}

#[test]
fn processes_that_write_the_index_keep_what_the_others_know() {
    let (_folder, one) = store();
    let two = Store::open(one.root()).unwrap();
    let (a, b) = (put(&one, &chunk(1, 1)), put(&two, &chunk(2, 1)));
    one.save_index();
    two.save_index();
    let known = indexed(&one);
    assert!(known.contains_key(&a) && known.contains_key(&b) && known.len() == 2);
}

#[test]
fn what_changed_while_a_process_ran_is_not_vouched_for_by_it() {
    let (_folder, one) = store();
    let early = put(&one, &chunk(1, 1));
    std::thread::sleep(Duration::from_millis(30));
    let two = Store::open(one.root()).unwrap();
    two.artifact(&early).unwrap();
    // Written after the other process began to look: within a tick its bytes might change again.
    let late = put(&one, &chunk(2, 1));
    two.artifact(&late).unwrap();
    two.save_index();
    assert_eq!(indexed(&one).keys().collect::<Vec<_>>(), [&early]);
    one.save_index();
    assert_eq!(indexed(&one).len(), 2);
}

#[test]
fn nothing_is_written_where_nothing_was_learnt() {
    let (_folder, store, digest) = known();
    let before = stamp_of(&index_path(&store));
    let another = Store::open(store.root()).unwrap();
    another.inspect(&digest, Effort::Quick).unwrap();
    another.save_index();
    store.save_index();
    assert_eq!(stamp_of(&index_path(&store)), before);
}

#[test]
fn what_is_gone_leaves_the_index() {
    let (_folder, store, digest) = known();
    let root = store.root().to_owned();
    drop(store);
    let alone = Store::open_exclusive(&root).unwrap();
    let all = Retention {
        runs: 0,
        grace: Duration::ZERO,
        free: None,
    };
    let collection = alone
        .plan_gc(&all, std::time::SystemTime::now() + Duration::from_secs(60))
        .unwrap();
    assert_eq!(collection.removed.len(), 1);
    alone.remove(&collection, "", &|_, _| ()).unwrap();
    assert!(!indexed(&alone).contains_key(&digest));
}

#[test]
fn a_manifest_is_made_without_opening_chunks_and_read_with_verifying_them() {
    let (_folder, store, digest) = known();
    flip_beneath(&store, &digest);
    let store = Store::open(store.root()).unwrap();
    let manifest = put(&store, &Object::manifest(Default::default(), vec![digest]));
    let error = store.artifact(&manifest).unwrap().u8s("patterns").unwrap_err();
    assert!(error.is_damage(), "{error}");
}

#[test]
fn actions_whose_keys_begin_alike_share_a_lock_and_others_do_not() {
    let (_folder, store) = store();
    let key = |second: u8, last: u8| {
        let mut bytes = [0; 32];
        (bytes[1], bytes[31]) = (second, last);
        ActionKey::from(Digest::from_bytes(bytes))
    };
    let held = store.try_lock_action(&key(0x10, 1)).unwrap().unwrap();
    assert!(store.try_lock_action(&key(0x10, 2)).unwrap().is_none());
    assert!(store.try_lock_action(&key(0x20, 1)).unwrap().is_some());
    drop(held);
    assert!(store.try_lock_action(&key(0x10, 2)).unwrap().is_some());
}

#[test]
fn what_one_process_finds_damaged_the_next_does_not_believe() {
    let (_folder, store, digest) = known();
    flip_beneath(&store, &digest);
    assert!(is_intact(&store, &digest), "the index was told so");
    // Somebody reads it, and ends with that error and no more.
    assert!(Store::open(store.root()).unwrap().artifact(&digest).is_err());
    assert!(is_damaged(&store, &digest));
}
