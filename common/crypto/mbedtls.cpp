#include <fmt/format.h>
#include <mbedtls/ecdsa.h>
#include <mbedtls/error.h>
#include <mbedtls/pk.h>
#include <mbedtls/sha256.h>
#include <mbedtls/version.h>
#include <sys/random.h>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

/// An object of mbedTLS, freed at the end: numbers and keys are wiped then.
template <typename T, auto Init, auto Free>
struct Owned {
  Owned() { Init(&value); }
  ~Owned() { Free(&value); }
  Owned(const Owned&) = delete;
  Owned& operator=(const Owned&) = delete;
  T value{};
};
using Number = Owned<mbedtls_mpi, mbedtls_mpi_init, mbedtls_mpi_free>;
using Point = Owned<mbedtls_ecp_point, mbedtls_ecp_point_init, mbedtls_ecp_point_free>;
using ParsedKey = Owned<mbedtls_pk_context, mbedtls_pk_init, mbedtls_pk_free>;

/// mbedTLS fills a table in the group at its first multiplication, without a lock: so each thread has a group of its
/// own.
struct Group : Owned<mbedtls_ecp_group, mbedtls_ecp_group_init, mbedtls_ecp_group_free> {
  explicit Group(mbedtls_ecp_group_id id) : valid(mbedtls_ecp_group_load(&value, id) == 0) {}
  bool valid;
};

Group& thread_group(Curve curve) {
  if (curve == Curve::p384) {
    thread_local Group group_of_p384(MBEDTLS_ECP_DP_SECP384R1);
    return group_of_p384;
  }
  thread_local Group group_of_p256(MBEDTLS_ECP_DP_SECP256R1);
  return group_of_p256;
}

/// mbedTLS's random source, for blinding: the operating system's.
int system_random(void*, unsigned char* out, std::size_t count) {
  while (count > 0) {
    const ssize_t n = ::getrandom(out, count, 0);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return MBEDTLS_ERR_ECP_RANDOM_FAILED;
    out += n;
    count -= static_cast<std::size_t>(n);
  }
  return 0;
}

std::string message_of(int code) { return fmt::format("mbedTLS error -0x{:04x}", static_cast<unsigned>(-code)); }

// What Debian 12's mbedTLS 2.28 and Debian 13's 3.6 have under two names.
#if MBEDTLS_VERSION_MAJOR >= 3
constexpr auto sha256 = mbedtls_sha256;

int parse_key(mbedtls_pk_context* key, const unsigned char* pem, std::size_t size) {
  return mbedtls_pk_parse_key(key, pem, size, nullptr, 0, system_random, nullptr);
}

int split(const mbedtls_ecp_keypair& pair, mbedtls_ecp_group_id& curve, mbedtls_mpi& secret) {
  curve = mbedtls_ecp_keypair_get_group_id(&pair);
  return mbedtls_ecp_export(&pair, nullptr, &secret, nullptr);
}
#else
constexpr auto sha256 = mbedtls_sha256_ret;

int parse_key(mbedtls_pk_context* key, const unsigned char* pem, std::size_t size) {
  return mbedtls_pk_parse_key(key, pem, size, nullptr, 0);
}

int split(const mbedtls_ecp_keypair& pair, mbedtls_ecp_group_id& curve, mbedtls_mpi& secret) {
  curve = pair.grp.id;
  return mbedtls_mpi_copy(&secret, &pair.d);
}
#endif

Digest digest_of(std::string_view message) {
  Digest out{};
  sha256(reinterpret_cast<const unsigned char*>(message.data()), message.size(), out.data(), 0);
  return out;
}

class MbedtlsSigner final : public Signer {
 public:
  /// Copies the secret number out of `pair`; says on which curve it is.
  int adopt(const mbedtls_ecp_keypair& pair, mbedtls_ecp_group_id& id) {
    const int code = split(pair, id, secret_.value);
    curve_ = id == MBEDTLS_ECP_DP_SECP384R1 ? Curve::p384 : Curve::p256;
    return code;
  }

  /// Deterministic nonces (RFC 6979): a weak random source cannot leak the key.
  Result<std::string> sign(std::string_view message) const override {
    Group& group = thread_group(curve_);
    if (!group.valid) return Error{"mbedTLS cannot sign: the key's curve is not built in"};
    const Digest digest = digest_of(message);
    Number r, s;
    EcdsaSignature signature;
    int code = mbedtls_ecdsa_sign_det_ext(&group.value, &r.value, &s.value, &secret_.value, digest.data(),
                                          digest.size(), MBEDTLS_MD_SHA256, system_random, nullptr);
    if (code == 0) code = mbedtls_mpi_write_binary(&r.value, signature.r.data(), signature.r.size());
    if (code == 0) code = mbedtls_mpi_write_binary(&s.value, signature.s.data(), signature.s.size());
    if (code != 0) return Error{"mbedTLS cannot sign: " + message_of(code)};
    return encode_signature(signature, curve_);
  }

 private:
  Number secret_;
  Curve curve_ = Curve::p256;
};

class MbedtlsVerifier final : public Verifier {
 public:
  explicit MbedtlsVerifier(Curve curve) : curve_(curve) {}

  int adopt(std::string_view point) {
    const mbedtls_ecp_group& group = thread_group(curve_).value;
    int code = mbedtls_ecp_point_read_binary(&group, &point_.value,
                                             reinterpret_cast<const unsigned char*>(point.data()), point.size());
    if (code == 0) code = mbedtls_ecp_check_pubkey(&group, &point_.value);
    return code;
  }

  bool verify(std::string_view message, std::string_view der) const override {
    Group& group = thread_group(curve_);
    const auto signature = decode_signature(der, curve_);
    if (!group.valid || !signature) return false;
    const Digest digest = digest_of(message);
    Number r, s;
    return mbedtls_mpi_read_binary(&r.value, signature->r.data(), signature->r.size()) == 0 &&
           mbedtls_mpi_read_binary(&s.value, signature->s.data(), signature->s.size()) == 0 &&
           mbedtls_ecdsa_verify(&group.value, digest.data(), digest.size(), &point_.value, &r.value, &s.value) == 0;
  }

 private:
  const Curve curve_;
  Point point_;
};

}  // namespace

Result<std::unique_ptr<Signer>> make_mbedtls_signer(const std::string& pem_key) {
  ParsedKey key;
  // The length that mbedTLS wants for PEM counts the final NUL.
  int code = parse_key(&key.value, reinterpret_cast<const unsigned char*>(pem_key.c_str()), pem_key.size() + 1);
  if (code != 0) return Error{"not a private key in PEM: " + message_of(code)};
  auto signer = std::make_unique<MbedtlsSigner>();
  auto curve = MBEDTLS_ECP_DP_NONE;
  if (mbedtls_pk_can_do(&key.value, MBEDTLS_PK_ECDSA) != 0) code = signer->adopt(*mbedtls_pk_ec(key.value), curve);
  if (code != 0) return Error{"cannot take over the private key: " + message_of(code)};
  if (curve != MBEDTLS_ECP_DP_SECP256R1 && curve != MBEDTLS_ECP_DP_SECP384R1)
    return Error{"the private key is on neither of the curves P-256 and P-384"};
  return std::unique_ptr<Signer>(std::move(signer));
}

Result<std::unique_ptr<Verifier>> make_mbedtls_verifier(const PublicPoint& point) {
  auto verifier = std::make_unique<MbedtlsVerifier>(point.curve);
  if (const int code = verifier->adopt(point.bytes); code != 0)
    return Error{"the certificate's key is no point of its curve: " + message_of(code)};
  return std::unique_ptr<Verifier>(std::move(verifier));
}

}  // namespace ledgerline::crypto
