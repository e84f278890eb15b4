#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.hpp"

/// Signatures and identities as Fabric uses them: ECDSA P-256 or P-384 over SHA-256, DER, low S (high S is refused).
/// The hash is SHA-256 on both curves: that is what Fabric's MSPs sign with (signature_hash_family SHA2). mbedTLS and
/// libcrypto are both built; the config says which one signs and which one verifies.
namespace ledgerline::crypto {

using Digest = std::array<unsigned char, 32>;
Digest sha256(std::string_view data);
std::string hex(std::string_view bytes);
std::string hex(const Digest& digest);
/// The bytes of which hex() makes that text; nullopt: it is none.
std::optional<std::string> unhex(std::string_view text);
/// The bytes that stand in this base64, which may have line ends; nullopt: it is none.
std::optional<std::string> unbase64(std::string_view text);

enum class Library { mbedtls, libcrypto };

/// Holds a private key. The key is neither copied out nor logged. sign() may be called from many threads at once.
class Signer {
 public:
  virtual ~Signer() = default;
  /// DER signature, low S, over SHA-256 of `message`.
  virtual Result<std::string> sign(std::string_view message) const = 0;
};
/// From a PEM key (PKCS#8 or SEC1).
Result<std::unique_ptr<Signer>> make_signer(Library library, const std::string& pem_key);

/// A public key that checks signatures; thread-safe.
class Verifier {
 public:
  virtual ~Verifier() = default;
  /// False for a wrong, malformed or high-S signature.
  virtual bool verify(std::string_view message, std::string_view der_signature) const = 0;
};
Result<std::unique_ptr<Verifier>> make_verifier(Library library, const std::string& pem_certificate);

/// Real nonces and ids; from the operating system.
std::string random_bytes(std::size_t count);

/// What a certificate says (parsed by libcrypto in any case).
struct Certificate {
  std::string subject;  ///< RFC 2253: "CN=User1@org1.ledgerline,OU=client,L=...": the identity with the MSP id
  std::string common_name;
  std::vector<std::string> units;                  ///< OU values: "admin", "client", "peer", "orderer" (NodeOUs)
  std::int64_t not_before_s = 0, not_after_s = 0;  ///< Unix time
  std::string issuer{};                            ///< as `subject`
};
Result<Certificate> parse_certificate(const std::string& pem);
/// The text of a PEM file that begins with a certificate, such as one with authorities. An error names the file.
Result<std::string> read_certificate_file(const std::string& path);
/// SHA-256 of the first certificate's DER: its fingerprint.
Result<Digest> certificate_hash(const std::string& pem);
/// By what an authority distinguishes the certificates that it has made, in hexadecimal. An error: it names no
/// authority's key.
struct CertificateNumber {
  std::string serial, authority_key;
};
Result<CertificateNumber> certificate_number(const std::string& pem);

/// Who signs: MSP id and certificate subject, so that it survives renewal.
struct IdentityName {
  std::string msp_id;
  std::string subject;
  auto operator<=>(const IdentityName&) const = default;
};

/// Checks serialized identities (msp.SerializedIdentity) against the CA certificates of each MSP, with a cache of those
/// already checked (bounded). An abstract class so that campaigns can use a test signer. Thread-safe.
class MspRegistry {
 public:
  struct Member {
    IdentityName name;
    std::string pem;
    bool admin = false;    ///< OU=admin
    bool peer = false;     ///< OU=peer: may endorse
    bool orderer = false;  ///< OU=orderer: may sign blocks
    std::shared_ptr<const Verifier> verifier;
  };
  virtual ~MspRegistry() = default;
  /// `serialized`: bytes of msp.SerializedIdentity. Unknown MSP, unknown CA, revoked, expired (at now_s; nullopt:
  /// whenever it was valid): an error in Fabric's words (without the "access denied:" around it).
  virtual Result<std::shared_ptr<const Member>> member(std::string_view serialized,
                                                       std::optional<std::int64_t> now_s) = 0;
};
struct MspRoot {
  std::string msp_id;
  std::string ca_pem;  ///< certificates of its authorities, root and intermediate
  /// X.509 CRLs; one that none of its authorities has signed is ignored, as in Fabric.
  std::string revocation_lists_pem{};
};
enum class ListsFrom {
  configuration,  ///< the channel's: while one has no readable authority key identifier, nobody of its MSP is a member
  hand            ///< handed over beside it: one without such an identifier is as good as any
};
std::unique_ptr<MspRegistry> make_msp_registry(Library library, std::vector<MspRoot> roots,
                                               ListsFrom lists_from = ListsFrom::configuration);
/// Whether the certificate is one of this organisation's, whenever it is valid: an error as of MspRegistry::member().
Status check_member(MspRoot organisation, const std::string& certificate_pem);

struct RevocationList {
  std::string msp_id;       ///< whose authority signed it
  std::int64_t made_s = 0;  ///< Unix time, as it says
};
/// For who hands lists over beside the authorities, where none may be ignored. An error: there is no list in it, one
/// cannot be read, or none of the authorities has signed it.
Result<std::vector<RevocationList>> read_revocation_lists(const std::string& pem, const std::vector<MspRoot>& roots);
/// The one list, as PEM, that Fabric reads in an entry of a configuration (Go's x509.ParseCRL): the first of a PEM text
/// that begins with it, or DER. An error: none can be read, with which Fabric takes no configuration.
Result<std::string> list_of_entry(const std::string& entry);
/// Whether one of these lists names the certificate; who signed the lists is not checked. An error: it cannot be read.
Result<bool> is_listed(const std::string& lists_pem, const std::string& certificate_pem);
/// Whether each list says by an authority key identifier which key has signed it (see ListsFrom::configuration).
bool lists_name_key(const std::string& pem);

/// Which authority's a revocation list is, and how new, as the list says itself.
struct ListOrigin {
  std::string issuer;                 ///< DER of its distinguished name
  std::optional<std::string> key_id;  ///< its authority key identifier; an organisation's authorities may share a name
  std::string number;                 ///< CRL number (RFC 5280, 5.2.3), big-endian without zeros in front; empty: none
  std::int64_t made_s = 0;            ///< Unix time
};
/// `entry`: PEM, of which the first list counts, or DER. An error: it cannot be read.
Result<ListOrigin> origin_of_list(const std::string& entry);
/// Whether a list of the one takes the place of one of the other: both are of the same key, or `old` does not say of
/// which.
bool is_of_same_authority(const ListOrigin& made, const ListOrigin& old);
/// By their numbers where both have one, else by their times. Two of one second are as new as each other.
bool is_older(const ListOrigin& made, const ListOrigin& other);

class IdentityInUse;

/// A signer with its name and its serialized form, ready to make transactions.
struct SigningIdentity {
  IdentityName name;
  std::string serialized;  ///< msp.SerializedIdentity
  std::shared_ptr<const Signer> signer;
  /// Where it is renewed while clients sign with it: what they sign with; none: this one.
  std::shared_ptr<IdentityInUse> in_use{};
};

/// The identity that a program signs with now. A signer takes the whole of it once a transaction and keeps it until
/// that has ended, so certificate and signature are always of one pair. Any thread.
class IdentityInUse {
 public:
  explicit IdentityInUse(SigningIdentity first) { replace(std::move(first)); }

  std::shared_ptr<const SigningIdentity> now() const {
    const std::lock_guard lock(mutex_);
    return now_;
  }
  void replace(SigningIdentity next) {
    auto whole = std::make_shared<const SigningIdentity>(std::move(next));
    const std::lock_guard lock(mutex_);
    now_.swap(whole);
  }

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<const SigningIdentity> now_;
};

/// From an MSP's folder: DIR/signcerts/*.pem and DIR/keystore/*_sk (cryptogen, fabric-ca), priv-key.pem (fablo) or the
/// only file that is there; names with a leading dot are passed over, as Kubernetes' secrets have them. The key by
/// read_key_file's rule.
Result<SigningIdentity> load_identity(Library library, const std::string& msp_id, const std::string& msp_dir);
/// The same from two files.
struct IdentityFiles {
  std::string certificate{}, private_key{};
};
Result<SigningIdentity> load_identity(Library library, const std::string& msp_id, const IdentityFiles& files);
/// Those that load_identity takes in such a folder: of several keys the one that the certificate is of, so that a
/// renewal with a new key is whole once the certificate is in its place.
Result<IdentityFiles> identity_files(const std::string& msp_dir);
/// Where an identity comes from, for who loads it again: a folder, or two files where `msp_dir` is empty.
struct IdentitySource {
  Library library = Library::libcrypto;
  std::string msp_id{}, msp_dir{};
  IdentityFiles files{};
  Result<IdentityFiles> files_now() const { return msp_dir.empty() ? files : identity_files(msp_dir); }
};
/// Who an identity is (msp.SerializedIdentity) and what its certificate says; whether an authority has signed it is not
/// looked at.
struct NamedCertificate {
  IdentityName name;
  Certificate certificate;
};
Result<NamedCertificate> read_serialized(std::string_view serialized);
/// The certificates of its authorities, in cacerts/ and intermediatecerts/, as PEM; empty: the folder has none.
Result<std::string> authorities_in(const std::string& msp_dir);
/// The bytes of msp.SerializedIdentity.
std::string serialized_identity(const std::string& msp_id, const std::string& certificate_pem);
Result<std::string> certificate_file(const std::string& msp_dir);
Result<std::string> key_file(const std::string& msp_dir);
/// The content of a private key's file, PEM or not. Refuses one that others may read (is_private()).
Result<std::string> read_key_file(const std::string& path);
/// The same of a key that a pass phrase locks (PKCS #8, "ENCRYPTED PRIVATE KEY"); one that is not locked is refused.
/// Takes some hundred milliseconds, as the phrase is made costly to guess.
Result<SigningIdentity> load_locked_identity(Library library, const std::string& msp_id, const std::string& msp_dir,
                                             const std::string& pass_phrase);
/// Whose the certificate of such a folder is; no key is read.
Result<IdentityName> read_identity_name(const std::string& msp_id, const std::string& msp_dir);
/// A key of PEM, locked: AES-256-CBC, PBKDF2 (600,000 rounds of HMAC-SHA256). As `openssl pkcs8 -topk8 -v2 aes-256-cbc
/// -v2prf hmacWithSHA256 -iter 600000`.
Result<std::string> lock_key(const std::string& pem_key, const std::string& pass_phrase);

/// A certificate authority of our own, for the embedded node and tests (libcrypto).
struct KeyAndCertificate {
  std::string key_pem;
  std::string certificate_pem;
};
struct CertificateRequest {
  std::string common_name;
  std::string organization;         ///< O
  std::optional<std::string> unit;  ///< OU
  std::vector<std::string> sans;    ///< DNS names and IP addresses
  bool tls = false;                 ///< server and client authentication
  int days = 3650;
};
Result<KeyAndCertificate> make_ca(const std::string& common_name, const std::string& organization);
Result<KeyAndCertificate> issue(const KeyAndCertificate& ca, const CertificateRequest& request);

// An identity whose key never leaves the host that it was made on: the authority sees the request alone.

/// The subject of a certificate request. An authority may leave out, or set by itself, all of it.
struct Subject {
  std::string common_name;
  std::string organization{};   ///< O; empty: none
  std::string unit = "client";  ///< OU: "admin", "client", "peer" (NodeOUs); empty: none
};
struct KeyAndRequest {
  std::string key_pem;
  std::string request_pem;  ///< PKCS #10, "CERTIFICATE REQUEST"
};
/// With a new key of P-256.
Result<KeyAndRequest> make_request(const Subject& subject);

/// An error: one of them cannot be read, or the certificate is of another key.
Status check_fits(const std::string& key_pem, const std::string& certificate_pem);

/// The certificates of a PEM text, in its order, without what stands between them.
std::vector<std::string> certificates_in(std::string_view pem);

/// These certificates with the key's own first and the others behind it in their order, since programs and peers take
/// the first for the own one, and an authority may deliver its own before it. The text as it is where it is in order.
/// An error: as check_fits, none is of that key.
Result<std::string> own_first(const std::string& key_pem, const std::string& certificates_pem);

/// An error: the certificate is not signed by this authority's own key.
Status check_issued_by(const std::string& ca_pem, const std::string& certificate_pem);

/// The CA's own certificate recreated, with the same name and key, that may sign documents: Fabric's CAs are for TLS
/// and certificates alone. What the CA has issued is of this one, too.
Result<std::string> make_document_authority(const KeyAndCertificate& ca);
/// S/MIME (PKCS #7, the text in the clear), as DDS Security takes its documents; `ca`'s certificate from above.
Result<std::string> sign_document(const KeyAndCertificate& ca, std::string_view text);

/// Deterministic stand-ins for campaigns: a signature is SHA-256 of name and message, which keeps the bytes the same
/// for a seed and costs microseconds. The serialized form is a msp.SerializedIdentity whose "certificate" is the text
/// "test:<subject>"; admins have subjects beginning with "CN=Admin", peers with "CN=peer". In the library
/// ledgerline_crypto_test, so that no real process has them.
SigningIdentity make_test_identity(const IdentityName& name);
std::unique_ptr<MspRegistry> make_test_registry(std::vector<std::string> msp_ids);

}  // namespace ledgerline::crypto
