#include "common/crypto/crypto.hpp"
#include "common/crypto/openssl.hpp"
#include "msp/identities.pb.h"
#include "tests/fuzz/entry.hpp"

/// Signatures, certificates, keys and serialized identities of outsiders.
namespace ledgerline::fuzz::crypto_part {
namespace {

using namespace crypto;

struct Material {
  KeyAndCertificate ca = make_ca("ca.org1.ledgerline", "org1.ledgerline").value();
  KeyAndCertificate user =
      issue(ca, {.common_name = "User1@org1.ledgerline", .organization = "", .unit = "client", .sans = {}}).value();
  std::int64_t now_s = parse_certificate(user.certificate_pem).value().not_before_s + 3600;
  std::string message = "what was signed";
};
const Material& material() {
  static const Material made;
  return made;
}

/// A signature is right or wrong without words; both libraries must say the same.
class SignatureEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    std::vector<std::string> all;
    for (const Library library : {Library::mbedtls, Library::libcrypto}) {
      all.push_back(*(*make_signer(library, material().user.key_pem))->sign(material().message));
    }
    return all;
  }
  Outcome feed(std::string_view bytes) override {
    const bool first = mbedtls_->verify(material().message, bytes);
    if (libcrypto_->verify(material().message, bytes) != first) return refused("");
    for (const Curve curve : {Curve::p256, Curve::p384}) {
      const auto decoded = decode_signature(bytes, curve);
      if (decoded && encode_signature(*decoded, curve) != bytes) return refused("");  // there is one way to write it
    }
    return first ? accepted() : dropped();
  }

 private:
  std::unique_ptr<Verifier> mbedtls_ = make_verifier(Library::mbedtls, material().user.certificate_pem).value();
  std::unique_ptr<Verifier> libcrypto_ = make_verifier(Library::libcrypto, material().user.certificate_pem).value();
};

std::string encrypted(std::string pem) {
  return pem.insert(pem.find('\n') + 1,
                    "Proc-Type: 4,ENCRYPTED\nDEK-Info: AES-128-CBC,000102030405060708090a0b0c0d0e0f\n\n");
}

/// DER of a certificate between its two lines: so that changes reach the parser behind base64.
std::string pem_of(std::string_view der) {
  static constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text = "-----BEGIN CERTIFICATE-----\n", line;
  for (std::size_t i = 0; i < der.size(); i += 3) {
    std::uint32_t three = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      three = three << 8 | (i + k < der.size() ? static_cast<unsigned char>(der[i + k]) : 0U);
    }
    for (int k = 3; k >= 0; --k) line += digits[three >> (6 * k) & 63];
    if (i + 2 >= der.size()) line.back() = '=';
    if (i + 1 >= der.size()) line[line.size() - 2] = '=';
    if (line.size() >= 64) text += line + "\n", line.clear();
  }
  return text + line + (line.empty() ? "" : "\n") + "-----END CERTIFICATE-----\n";
}
std::string der_of(const std::string& pem) {
  std::string der;
  std::uint32_t bits = 0;
  int count = 0;
  const std::size_t begin = pem.find('\n') + 1;
  for (const char c : pem.substr(begin, pem.find("-----END") - begin)) {
    const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const std::size_t value = std::string_view(digits).find(c);
    if (value == std::string_view::npos) continue;
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    if (++count % 4 != 1) der += static_cast<char>(bits >> (2 * (3 - (count - 1) % 4)) & 0xff);
  }
  return der;
}

Outcome read_both(const std::string& pem) {
  const auto certificate = parse_certificate(pem);
  for (const Library library : {Library::mbedtls, Library::libcrypto}) {
    const auto verifier = make_verifier(library, pem);
    if (verifier && (*verifier)->verify("x", "y")) return refused("");
    if (certificate && !verifier) return refused(verifier.error().message);
  }
  return outcome_of(certificate);
}

std::unique_ptr<Entry> certificate() {
  return std::make_unique<Function>(
      std::vector<std::string>{material().user.certificate_pem, material().ca.certificate_pem},
      [](std::string_view bytes) { return read_both(std::string(bytes)); });
}

std::unique_ptr<Entry> certificate_der() {
  return std::make_unique<Function>(
      std::vector<std::string>{der_of(material().user.certificate_pem), der_of(material().ca.certificate_pem)},
      [](std::string_view bytes) { return read_both(pem_of(bytes)); });
}

std::unique_ptr<Entry> private_key() {
  return std::make_unique<Function>(std::vector<std::string>{material().user.key_pem}, [](std::string_view bytes) {
    const auto first = make_signer(Library::mbedtls, std::string(bytes));
    const auto second = make_signer(Library::libcrypto, std::string(bytes));
    if (!first) return refused(first.error().message);
    return outcome_of(second);
  });
}

std::string serialized(const std::string& pem) {
  msp::SerializedIdentity identity;
  identity.set_mspid("Org1MSP");
  identity.set_id_bytes(pem);
  return identity.SerializeAsString();
}

class IdentityEntry final : public Entry {
 public:
  /// `der`: the input is the certificate's DER alone.
  explicit IdentityEntry(bool der) : der_(der) {}
  std::vector<std::string> seeds() override {
    if (der_) return {der_of(material().user.certificate_pem)};
    return {serialized(material().user.certificate_pem)};
  }
  Outcome feed(std::string_view bytes) override {
    const std::string identity = der_ ? serialized(pem_of(bytes)) : std::string(bytes);
    const auto member = registry_->member(identity, material().now_s);
    if (!member) return refused(member.error().message);
    const bool right = (*member)->name == IdentityName{"Org1MSP", "CN=User1@org1.ledgerline,OU=client"};
    return right && !(*member)->admin && !(*member)->peer ? accepted() : refused("");
  }

 private:
  bool der_;
  std::unique_ptr<MspRegistry> registry_ =
      make_msp_registry(Library::libcrypto, {{"Org1MSP", material().ca.certificate_pem}});
};

/// Never to be asked for a pass phrase.
std::unique_ptr<Entry> encrypted_certificate() {
  return std::make_unique<Function>(
      std::vector<std::string>{material().user.certificate_pem}, [](std::string_view bytes) {
        const std::string pem(bytes);
        if (pem == material().user.certificate_pem) return accepted();
        return outcome_of(parse_certificate(encrypted(pem.find('\n') == std::string::npos ? pem + "\n" : pem)));
      });
}

const Registration der({"crypto.signature", Kind::bytes, [] { return std::make_unique<SignatureEntry>(); }});
const Registration pem({"crypto.certificate", Kind::text, certificate});
const Registration pem_der({"crypto.certificate_der", Kind::bytes, certificate_der});
const Registration pem_encrypted({"crypto.certificate_encrypted", Kind::text, encrypted_certificate, 0.2, 0});
const Registration key({"crypto.private_key", Kind::text, private_key});
const Registration identity({"crypto.identity", Kind::protobuf, [] { return std::make_unique<IdentityEntry>(false); }});
const Registration identity_der({"crypto.identity_der", Kind::bytes,
                                 [] { return std::make_unique<IdentityEntry>(true); }, 0.2, 0});

}  // namespace
}  // namespace ledgerline::fuzz::crypto_part
