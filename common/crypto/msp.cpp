#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509_vfy.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <list>
#include <map>
#include <mutex>
#include <unordered_map>

#include "common/base/text.hpp"
#include "common/crypto/openssl.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::crypto {
namespace {

/// Only identities that a CA signed get in, so this bounds memory and not how many may take part.
constexpr std::size_t cache_size = 1024;
/// Far above any real certificate; keeps hostile bytes away from the parser.
constexpr std::size_t max_identity_bytes = 64 * 1024;

using StorePtr = std::unique_ptr<X509_STORE, Freed<X509_STORE_free>>;
using StoreContextPtr = std::unique_ptr<X509_STORE_CTX, Freed<X509_STORE_CTX_free>>;

struct Validity {
  std::int64_t from_s = 0, to_s = 0;
  /// In whole seconds: what is left of the last one is over for Fabric, too.
  bool holds(std::int64_t now_s) const { return now_s >= from_s && now_s < to_s; }
};

/// Remembers which signatures it has found right last: a node that orders a transaction commits it a moment later.
class RememberingVerifier final : public Verifier {
 public:
  explicit RememberingVerifier(std::unique_ptr<Verifier> verifier) : verifier_(std::move(verifier)) {}

  bool verify(std::string_view message, std::string_view der_signature) const override {
    const Digest digest = crypto::sha256(message);
    std::string both(digest.begin(), digest.end());
    both += der_signature;
    {
      const std::lock_guard lock(mutex_);
      if (std::ranges::find(right_, both) != right_.end()) return true;
    }
    if (!verifier_->verify(message, der_signature)) return false;
    const std::lock_guard lock(mutex_);
    right_[next_] = std::move(both);
    next_ = (next_ + 1) % right_.size();
    return true;
  }

 private:
  const std::unique_ptr<Verifier> verifier_;
  mutable std::mutex mutex_;
  mutable std::array<std::string, 32> right_;  ///< digest and signature
  mutable std::size_t next_ = 0;
};

class CachingRegistry final : public MspRegistry {
 public:
  CachingRegistry(Library library, std::vector<MspRoot> roots, ListsFrom lists_from)
      : library_(library), lists_from_(lists_from) {
    for (const MspRoot& root : roots) {
      Authorities& known = roots_[root.msp_id];
      known.ca_pem += root.ca_pem + "\n";
      for (CrlPtr& list : read_lists(root.revocation_lists_pem)) known.lists.push_back(std::move(list));
    }
  }

  Result<std::shared_ptr<const Member>> member(std::string_view serialized,
                                               std::optional<std::int64_t> now_s) override {
    const std::lock_guard lock(mutex_);
    auto found = index_.find(serialized);
    if (found == index_.end()) {
      auto checked = check(serialized);
      if (!checked) return checked.error();
      found = remember(std::move(*checked));
    } else {
      entries_.splice(entries_.begin(), entries_, found->second);
    }
    const Entry& entry = *found->second;
    if (now_s && !entry.validity.holds(*now_s)) {
      return Error{"the supplied identity is not valid: x509: certificate has expired or is not yet valid"};
    }
    return entry.member;
  }

 private:
  struct Authorities {
    std::string ca_pem;
    std::vector<CrlPtr> lists;
  };
  struct Entry {
    std::string serialized;
    std::shared_ptr<const Member> member;
    Validity validity;
  };
  using Index = std::unordered_map<std::string_view, std::list<Entry>::iterator>;

  Index::iterator remember(Entry entry) {
    if (entries_.size() == cache_size) {
      index_.erase(entries_.back().serialized);
      entries_.pop_back();
    }
    entries_.push_front(std::move(entry));
    return index_.emplace(entries_.front().serialized, entries_.begin()).first;
  }

  Result<Entry> check(std::string_view serialized) const {
    msp::SerializedIdentity identity;
    if (serialized.size() > max_identity_bytes ||
        !identity.ParseFromArray(serialized.data(), static_cast<int>(serialized.size()))) {
      return Error{"could not deserialize a SerializedIdentity"};
    }
    const auto root = roots_.find(identity.mspid());
    if (root == roots_.end()) return Error{fmt::format("MSP {} is unknown", printable(identity.mspid(), 200))};
    auto certificate = read_certificate(identity.id_bytes());
    if (!certificate) return certificate.error();
    Entry entry;
    entry.serialized = serialized;
    auto validity = check_chain(root->second, certificate->get());
    if (!validity) return validity.error();
    entry.validity = *validity;
    auto description = describe(certificate->get());
    if (!description) return description.error();
    auto verifier = make_verifier(library_, certificate->get());
    if (!verifier) return verifier.error();
    if (Status status = check_units(*description, identity.mspid()); !status) return status.error();
    const auto has_unit = [&](std::string_view unit) {
      return std::find(description->units.begin(), description->units.end(), unit) != description->units.end();
    };
    entry.member = std::make_shared<const Member>(Member{{identity.mspid(), description->subject},
                                                         identity.id_bytes(),
                                                         has_unit("admin"),
                                                         has_unit("peer"),
                                                         has_unit("orderer"),
                                                         std::make_shared<RememberingVerifier>(std::move(*verifier))});
    return entry;
  }

  /// Exactly one of the roles that NodeOUs name, as Fabric demands it.
  static Status check_units(const Certificate& certificate, const std::string& msp_id) {
    const auto is_role = [](const std::string& unit) {
      return unit == "client" || unit == "peer" || unit == "admin" || unit == "orderer";
    };
    const auto roles = std::count_if(certificate.units.begin(), certificate.units.end(), is_role);
    if (roles == 1) return done;
    const std::string units = fmt::format("OUs: [{}], MSP: [{}]", fmt::join(certificate.units, ", "), msp_id);
    if (roles == 0) {
      return Error{"the identity does not have an OU that resolves to client, peer, orderer, or admin role. " + units};
    }
    return Error{
        "the identity must be a client, a peer, an orderer or an admin identity to be valid, not a combination of "
        "them. " +
        units};
  }

  /// Returns when the identity is valid: within its own validity and that of each CA above it. The validity is looked
  /// at on every use, so the chain is checked without the time.
  Result<Validity> check_chain(const Authorities& authorities, X509* certificate) const {
    if (X509_check_ca(certificate) != 0) {
      return Error{
          "An X509 certificate with Basic Constraint: Certificate Authority equals true cannot be used as an identity"};
    }
    const StorePtr store(X509_STORE_new());
    for (const X509Ptr& ca : read_certificates(authorities.ca_pem)) X509_STORE_add_cert(store.get(), ca.get());
    ERR_clear_error();
    const StoreContextPtr context(X509_STORE_CTX_new());
    if (!context || X509_STORE_CTX_init(context.get(), store.get(), certificate, nullptr) != 1) {
      return Error{"cannot check a certificate: " + openssl_error()};
    }
    X509_STORE_CTX_set_flags(context.get(), X509_V_FLAG_NO_CHECK_TIME);
    if (X509_verify_cert(context.get()) != 1) {
      ERR_clear_error();
      return Error{fmt::format("the supplied identity is not valid: x509: certificate signed by unknown authority ({})",
                               X509_verify_cert_error_string(X509_STORE_CTX_get_error(context.get())))};
    }
    Validity validity{0, INT64_MAX};
    const STACK_OF(X509)* chain = X509_STORE_CTX_get0_chain(context.get());
    for (int i = 0; i < sk_X509_num(chain); ++i) {
      auto link = describe(sk_X509_value(chain, i));
      if (!link) return link.error();
      validity.from_s = std::max(validity.from_s, link->not_before_s);
      validity.to_s = std::min(validity.to_s, link->not_after_s);
      if (i == 0) continue;
      if (Status s = check_lists(authorities, sk_X509_value(chain, i - 1), sk_X509_value(chain, i)); !s) {
        return Error{"the supplied identity is not valid: " + s.error().message};
      }
    }
    return validity;
  }

  /// A list counts whenever it was made, and until there is another. Fabric finds those of a configuration by the key
  /// that they name (msp/mspimplvalidate.go, validateCertAgainstChain), and takes nobody where one names none, no
  /// matter who signed it.
  Status check_lists(const Authorities& authorities, X509* certificate, X509* issuer) const {
    for (const CrlPtr& list : authorities.lists) {
      if (lists_from_ == ListsFrom::configuration) {
        const auto key = authority_key_of(list.get());
        if (!key) return Error{"could not obtain Authority Key Identifier for crl"};
        if (!is_key_of(*key, issuer)) continue;
      }
      if (is_revoked(list.get(), certificate, issuer)) return Error{"The certificate has been revoked"};
    }
    return done;
  }

  static bool is_key_of(std::string_view id, X509* issuer) {
    const ASN1_OCTET_STRING* own = X509_get0_subject_key_id(issuer);
    return own != nullptr && id == text_of(own);
  }

  static bool is_revoked(X509_CRL* list, X509* certificate, X509* issuer) {
    X509_REVOKED* entry = nullptr;
    // 2: removed from the list again, which Fabric does not know
    if (X509_CRL_get0_by_serial(list, &entry, X509_get_serialNumber(certificate)) == 0) return false;
    const bool signed_by_issuer = X509_CRL_verify(list, X509_get0_pubkey(issuer)) == 1;
    ERR_clear_error();
    return signed_by_issuer;
  }

  const Library library_;
  const ListsFrom lists_from_;
  std::map<std::string, Authorities> roots_;  ///< by MSP id
  std::mutex mutex_;
  std::list<Entry> entries_;  ///< newest use first
  Index index_;               ///< keys point into entries_
};

}  // namespace

std::unique_ptr<MspRegistry> make_msp_registry(Library library, std::vector<MspRoot> roots, ListsFrom lists_from) {
  return std::make_unique<CachingRegistry>(library, std::move(roots), lists_from);
}

Status check_member(MspRoot organisation, const std::string& certificate_pem) {
  const std::string serialized = serialized_identity(organisation.msp_id, certificate_pem);
  const auto member =
      make_msp_registry(Library::libcrypto, {std::move(organisation)})->member(serialized, std::nullopt);
  return member ? done : Status(member.error());
}

}  // namespace ledgerline::crypto
