//! Ed25519 keys (RFC 8032) to sign records and to verify the signatures of others.

use std::fmt;
use std::fs;
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::str::FromStr;

use ring::rand::{SecureRandom, SystemRandom};
use ring::signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey};

use super::error::RemoteError;
use deaflow_base::{Digest, InputError, read_bounded};

/// First word in the line of a public key.
const PUBLIC: &str = "ed25519";

/// First word in the line of a private key.
const PRIVATE: &str = "ed25519-private";

/// Maximum length of a key file in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Length of a signature in bytes.
pub const SIGNATURE: usize = 64;

/// The public key of a signer.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PublicKey(Digest);

impl PublicKey {
    /// Returns whether the signature of the bytes is valid for this key.
    #[must_use]
    pub fn has_signed(&self, bytes: &[u8], signature: &[u8]) -> bool {
        UnparsedPublicKey::new(&ED25519, self.0.as_bytes())
            .verify(bytes, signature)
            .is_ok()
    }

    /// Returns the first digits, for messages.
    #[must_use]
    pub fn short(&self) -> String {
        self.0.short()
    }

    /// Returns the line of a key file.
    #[must_use]
    pub fn line(&self, owner: &str) -> String {
        format!("{PUBLIC} {} {owner}\n", self.0)
    }
}

/// Writes the 64 hexadecimal digits.
impl fmt::Display for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Debug for PublicKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PublicKey({})", self.short())
    }
}

impl FromStr for PublicKey {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        // Only one spelling is valid, because keys are parts of object names.
        let digest: Digest = text.parse().map_err(|_| ())?;
        (digest.to_string() == text).then_some(Self(digest)).ok_or(())
    }
}

/// A trusted public key with the name of its owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrustedKey {
    /// The key.
    pub key: PublicKey,
    /// Name of the owner in the key file; may be empty.
    pub owner: String,
}

/// Reads a file of public keys with one line `ed25519 DIGITS NAME` per key. Empty lines and lines that start with `#`
/// are skipped.
///
/// # Errors
/// Returns an error if the file cannot be read, has an invalid line, or has no key.
pub fn read_public_keys(path: &Path) -> Result<Vec<TrustedKey>, InputError> {
    let bytes = read_bounded(path, MAX_BYTES)
        .map_err(|error| InputError::new(format!("cannot read the key file {}: {error}", path.display())))?;
    let text = String::from_utf8_lossy(&bytes);
    let mut keys = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let at = format!("{}:{}", path.display(), number + 1);
        let mut words = line.split_whitespace();
        let (kind, digits) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        if kind == PRIVATE {
            return Err(InputError::new(format!("{at}: this is a private key"))
                .help("keep it secret; `deaflow remote key` prints your public key"));
        }
        let key = digits.parse().ok().filter(|_| kind == PUBLIC);
        let key = key.ok_or_else(|| {
            InputError::new(format!("{at}: not a public key")).help(
                "expected: `ed25519`, 64 lower-case hexadecimal digits and a name, as printed by `deaflow remote key`",
            )
        })?;
        keys.push(TrustedKey {
            key,
            owner: words.collect::<Vec<_>>().join(" "),
        });
    }
    match keys.is_empty() {
        true => Err(InputError::new(format!("{} contains no public key", path.display()))
            .help("add the line that `deaflow remote key` prints for the user who pushes")),
        false => Ok(keys),
    }
}

/// The private key that signs records.
pub struct SigningKey(Ed25519KeyPair);

impl SigningKey {
    /// Reads the key from a file, or returns `None` if the file does not exist.
    ///
    /// # Errors
    /// Returns an error if the file is not a private key, or other users can read it.
    pub fn read(path: &Path) -> Result<Option<Self>, RemoteError> {
        let metadata = match fs::metadata(path) {
            Ok(metadata) => metadata,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                let message = format!("cannot read the private key {}: {error}", path.display());
                return Err(InputError::new(message).into());
            }
        };
        if metadata.permissions().mode() & 0o077 != 0 {
            return Err(InputError::new(format!(
                "other users can read or write the private key {}",
                path.display()
            ))
            .help(format!(
                "run `chmod 600 {}`; if somebody may have read it, remove it and create a new key",
                path.display()
            ))
            .into());
        }
        let bytes = read_bounded(path, MAX_BYTES)
            .map_err(|error| InputError::new(format!("cannot read the private key {}: {error}", path.display())))?;
        let text = String::from_utf8_lossy(&bytes);
        let seed = text
            .trim()
            .strip_prefix(PRIVATE)
            .and_then(|digits| digits.trim().parse::<Digest>().ok());
        let pair = seed.and_then(|seed| Ed25519KeyPair::from_seed_unchecked(seed.as_bytes()).ok());
        match pair {
            Some(pair) => Ok(Some(Self(pair))),
            None => Err(InputError::new(format!("{} is not a private key", path.display()))
                .help("expected: `ed25519-private` and 64 hexadecimal digits, as created by `deaflow remote key`")
                .into()),
        }
    }

    /// Creates a key and writes it to a file that only the user can read.
    ///
    /// # Errors
    /// Returns an error if the file exists or cannot be written.
    pub fn create(path: &Path) -> Result<Self, RemoteError> {
        let mut seed = [0; 32];
        let refused = |error| RemoteError::io("create", path)(error);
        SystemRandom::new()
            .fill(&mut seed)
            .map_err(|_| refused(std::io::Error::other("the system has no random numbers")))?;
        let pair = Ed25519KeyPair::from_seed_unchecked(&seed)
            .map_err(|_| refused(std::io::Error::other("the seed was rejected")))?;
        let mut file = fs::OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(path)
            .map_err(refused)?;
        let text = format!("{PRIVATE} {}\n", Digest::from_bytes(seed));
        let written = file.write_all(text.as_bytes()).and_then(|()| file.sync_all());
        if let Err(error) = written {
            // An incomplete file would block the creation of another key.
            let _ = fs::remove_file(path);
            return Err(refused(error));
        }
        Ok(Self(pair))
    }

    /// Returns the public key, which verifies the signatures.
    #[must_use]
    pub fn public(&self) -> PublicKey {
        let mut bytes = [0; 32];
        bytes.copy_from_slice(self.0.public_key().as_ref());
        PublicKey(Digest::from_bytes(bytes))
    }

    /// Signs bytes.
    #[must_use]
    pub fn sign(&self, bytes: &[u8]) -> Vec<u8> {
        self.0.sign(bytes).as_ref().to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 8032, section 7.1, test 2.
    const SEED: &str = "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb";
    const PUBLIC_KEY: &str = "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c";
    const SIGNED: &str = "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da";

    fn write(path: &Path, text: &str, mode: u32) {
        fs::write(path, text).unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn a_signature_is_that_of_the_standard() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        write(&path, &format!("{PRIVATE} {SEED}\n"), 0o600);
        let key = SigningKey::read(&path).unwrap().unwrap();
        assert_eq!(key.public().to_string(), PUBLIC_KEY);
        let signature = key.sign(&[0x72]);
        let first: [u8; 32] = signature[..32].try_into().unwrap();
        assert_eq!(Digest::from_bytes(first).to_string(), SIGNED);
        assert!(key.public().has_signed(&[0x72], &signature));
        assert!(!key.public().has_signed(&[0x73], &signature));
        assert!(!key.public().has_signed(&[0x72], &signature[..63]));
    }

    #[test]
    fn a_private_key_is_created_once_and_readable_by_its_user_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        assert!(SigningKey::read(&path).unwrap().is_none());
        let made = SigningKey::create(&path).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(SigningKey::read(&path).unwrap().unwrap().public(), made.public());
        assert!(SigningKey::create(&path).is_err());
        write(&path, &fs::read_to_string(&path).unwrap(), 0o640);
        let error = SigningKey::read(&path).err().unwrap().to_string();
        assert!(error.contains(&path.display().to_string()), "{error}");
        write(&path, "ed25519-private 12", 0o600);
        assert!(SigningKey::read(&path).is_err());
    }

    #[test]
    fn errors_in_a_key_file_name_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lab.pub");
        let read = |text: &str| {
            fs::write(&path, text).unwrap();
            read_public_keys(&path)
        };
        let keys = read(&format!("# the lab\n\ned25519 {PUBLIC_KEY} anna  at lab\n")).unwrap();
        assert_eq!((keys.len(), keys[0].owner.as_str()), (1, "anna at lab"));
        assert_eq!(keys[0].key.line("anna"), format!("ed25519 {PUBLIC_KEY} anna\n"));
        for (text, place) in [
            ("", "lab.pub"),
            ("# nothing\n", "lab.pub"),
            ("ed25519 12 anna", "lab.pub:1:"),
            (&format!("\nrsa {PUBLIC_KEY}"), "lab.pub:2:"),
            (&format!("ed25519 {} anna", PUBLIC_KEY.to_uppercase()), "lab.pub:1:"),
            (&format!("{PRIVATE} {SEED}"), "lab.pub:1: this is a private key"),
        ] {
            let error = read(text).err().unwrap().to_string();
            assert!(error.contains(place), "{error}");
        }
    }
}
