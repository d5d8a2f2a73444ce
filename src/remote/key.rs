//! Ed25519 keys (RFC 8032): whoever signs records, and whose records count.

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

/// The word before the digits of a public key.
const PUBLIC: &str = "ed25519";

/// The word before the digits of a private key.
const PRIVATE: &str = "ed25519-private";

/// A file of keys is shorter, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Bytes of a signature.
pub const SIGNATURE: usize = 64;

/// Whose records count.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PublicKey(Digest);

impl PublicKey {
    /// Whether it has signed these bytes.
    #[must_use]
    pub fn has_signed(&self, bytes: &[u8], signature: &[u8]) -> bool {
        UnparsedPublicKey::new(&ED25519, self.0.as_bytes())
            .verify(bytes, signature)
            .is_ok()
    }

    /// The first digits, for people.
    #[must_use]
    pub fn short(&self) -> String {
        self.0.short()
    }

    /// The line of a file of keys.
    #[must_use]
    pub fn line(&self, whose: &str) -> String {
        format!("{PUBLIC} {} {whose}\n", self.0)
    }
}

/// Its 64 hexadecimal digits.
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
        // Spelt in one way only, since it is a name.
        let digest: Digest = text.parse().map_err(|_| ())?;
        (digest.to_string() == text).then_some(Self(digest)).ok_or(())
    }
}

/// A public key with the name that a file of keys gives it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// The key.
    pub key: PublicKey,
    /// Whose it is, as the file says; may be empty.
    pub whose: String,
}

/// Reads a file of public keys: a line `ed25519 DIGITS NAME` for each; empty lines and those that begin with `#` say nothing.
///
/// # Errors
/// When the file cannot be read, a line is no key, or there is none.
pub fn read_public(path: &Path) -> Result<Vec<Named>, InputError> {
    let bytes = read_bounded(path, MAX_BYTES)
        .map_err(|error| InputError::new(format!("cannot read the keys {}: {error}", path.display())))?;
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
                .help("keep it to yourself; `deaflow remote key` prints the public key that belongs to yours"));
        }
        let key = digits.parse().ok().filter(|_| kind == PUBLIC);
        let key = key.ok_or_else(|| {
            InputError::new(format!("{at}: this is no public key")).help(
                "a line is `ed25519`, 64 lower-case hexadecimal digits and a name, as `deaflow remote key` prints it",
            )
        })?;
        keys.push(Named {
            key,
            whose: words.collect::<Vec<_>>().join(" "),
        });
    }
    match keys.is_empty() {
        true => Err(
            InputError::new(format!("{}: there is no public key in it", path.display()))
                .help("`deaflow remote key` prints the line of whoever pushes"),
        ),
        false => Ok(keys),
    }
}

/// The key with which records are signed.
pub struct SigningKey(Ed25519KeyPair);

impl SigningKey {
    /// Reads the key of a file; none where there is no file.
    ///
    /// # Errors
    /// When it is no private key, or others may read it.
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
            return Err(
                InputError::new(format!("others may read or write the private key {}", path.display()))
                    .help(format!(
                        "chmod 600 {}; if they may have read it, remove it and make another",
                        path.display()
                    ))
                    .into(),
            );
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
            None => Err(InputError::new(format!("{} is no private key", path.display()))
                .help("it is `ed25519-private` and 64 hexadecimal digits; `deaflow remote key` makes one where there is none")
                .into()),
        }
    }

    /// Makes a new key and writes it to a file that only the user may read.
    ///
    /// # Errors
    /// When there is a file already, or the system refuses.
    pub fn create(path: &Path) -> Result<Self, RemoteError> {
        let mut seed = [0; 32];
        let refused = |error| RemoteError::io("make", path)(error);
        SystemRandom::new()
            .fill(&mut seed)
            .map_err(|_| refused(std::io::Error::other("the system gives no random numbers")))?;
        let pair = Ed25519KeyPair::from_seed_unchecked(&seed)
            .map_err(|_| refused(std::io::Error::other("the numbers are no key")))?;
        let mut file = fs::OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(path)
            .map_err(refused)?;
        let text = format!("{PRIVATE} {}\n", Digest::from_bytes(seed));
        let written = file.write_all(text.as_bytes()).and_then(|()| file.sync_all());
        if let Err(error) = written {
            // Half a key would stand in the way of the next one.
            let _ = fs::remove_file(path);
            return Err(refused(error));
        }
        Ok(Self(pair))
    }

    /// The key by which others know what it has signed.
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
    fn a_private_key_is_made_once_and_for_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        assert!(SigningKey::read(&path).unwrap().is_none());
        let made = SigningKey::create(&path).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(SigningKey::read(&path).unwrap().unwrap().public(), made.public());
        assert!(SigningKey::create(&path).is_err());
        write(&path, &fs::read_to_string(&path).unwrap(), 0o640);
        let error = SigningKey::read(&path).err().unwrap().to_string();
        assert!(error.contains("others may read"), "{error}");
        write(&path, "ed25519-private 12", 0o600);
        assert!(SigningKey::read(&path).is_err());
    }

    #[test]
    fn a_file_of_keys_says_what_is_wrong_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lab.pub");
        let read = |text: &str| {
            fs::write(&path, text).unwrap();
            read_public(&path)
        };
        let keys = read(&format!("# the lab\n\ned25519 {PUBLIC_KEY} anna  at lab\n")).unwrap();
        assert_eq!((keys.len(), keys[0].whose.as_str()), (1, "anna at lab"));
        assert_eq!(keys[0].key.line("anna"), format!("ed25519 {PUBLIC_KEY} anna\n"));
        for (text, says) in [
            ("", "no public key in it"),
            ("# nothing\n", "no public key in it"),
            ("ed25519 12 anna", "lab.pub:1: this is no public key"),
            (&format!("\nrsa {PUBLIC_KEY}"), "lab.pub:2: this is no public key"),
            (&format!("ed25519 {} anna", PUBLIC_KEY.to_uppercase()), "no public key"),
            (&format!("{PRIVATE} {SEED}"), "private key"),
        ] {
            let error = read(text).err().unwrap().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
