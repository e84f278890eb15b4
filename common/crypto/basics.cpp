#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <sys/random.h>

#include <cerrno>
#include <charconv>
#include <climits>
#include <stdexcept>
#include <system_error>

#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

// libcrypto would clear itself away at exit, under threads that nobody can join (gRPC's own): they would leak their
// random generators then, or use what is gone. Has to come before anything else of libcrypto.
[[maybe_unused]] const int stays_until_the_end = ::OPENSSL_init_crypto(OPENSSL_INIT_NO_ATEXIT, nullptr);

}  // namespace

Digest sha256(std::string_view data) {
  // Fetched once: libcrypto's own one-shot calls look the algorithm up each time, which is most of a small digest.
  static const EVP_MD* const algorithm = EVP_MD_fetch(nullptr, "SHA256", nullptr);
  thread_local const MdContextPtr context(EVP_MD_CTX_new());
  Digest out;
  const bool made = EVP_DigestInit_ex2(context.get(), algorithm, nullptr) == 1 &&
                    EVP_DigestUpdate(context.get(), data.data(), data.size()) == 1 &&
                    EVP_DigestFinal_ex(context.get(), out.data(), nullptr) == 1;
  if (!made) throw std::runtime_error("libcrypto makes no SHA-256: " + openssl_error());
  return out;
}

std::string hex(std::string_view bytes) {
  constexpr char digits[] = "0123456789abcdef";
  std::string out;
  out.reserve(bytes.size() * 2);
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    out.push_back(digits[byte >> 4]);
    out.push_back(digits[byte & 15]);
  }
  return out;
}

std::string hex(const Digest& digest) {
  return hex(std::string_view(reinterpret_cast<const char*>(digest.data()), digest.size()));
}

std::optional<std::string> unhex(std::string_view text) {
  if (text.size() % 2 != 0) return std::nullopt;
  std::string bytes;
  bytes.reserve(text.size() / 2);
  for (; !text.empty(); text.remove_prefix(2)) {
    unsigned char byte = 0;
    const char* const end = text.data() + 2;
    const auto [at, error] = std::from_chars(text.data(), end, byte, 16);
    if (error != std::errc() || at != end) return std::nullopt;
    bytes.push_back(static_cast<char>(byte));
  }
  return bytes;
}

std::optional<std::string> unbase64(std::string_view text) {
  std::string plain;
  for (const char c : text)
    if (c != '\n' && c != '\r' && c != ' ') plain += c;
  const std::size_t filled = plain.ends_with("==") ? 2 : plain.ends_with('=') ? 1 : 0;
  if (plain.empty() || plain.size() % 4 != 0 || plain.size() > INT_MAX) return std::nullopt;
  std::string bytes(plain.size() / 4 * 3, '\0');
  const int size =
      ::EVP_DecodeBlock(reinterpret_cast<unsigned char*>(bytes.data()),
                        reinterpret_cast<const unsigned char*>(plain.data()), static_cast<int>(plain.size()));
  if (size < 0) return std::nullopt;
  bytes.resize(static_cast<std::size_t>(size) - filled);
  return bytes;
}

std::string random_bytes(std::size_t count) {
  std::string out(count, '\0');
  std::size_t have = 0;
  while (have < count) {
    const ssize_t n = ::getrandom(out.data() + have, count - have, 0);
    if (n < 0 && errno == EINTR) continue;
    // Nothing can go on safely without randomness, and it only fails on kernels older than 3.17.
    if (n < 0) throw std::runtime_error("the operating system gives no random bytes (getrandom)");
    have += static_cast<std::size_t>(n);
  }
  return out;
}

Result<std::unique_ptr<Signer>> make_signer(Library library, const std::string& pem_key) {
  return library == Library::mbedtls ? make_mbedtls_signer(pem_key) : make_libcrypto_signer(pem_key);
}

Result<std::unique_ptr<Verifier>> make_verifier(Library library, X509* certificate) {
  if (library == Library::libcrypto) return make_libcrypto_verifier(certificate);
  auto point = public_point(certificate);
  if (!point) return point.error();
  return make_mbedtls_verifier(*point);
}

Result<std::unique_ptr<Verifier>> make_verifier(Library library, const std::string& pem_certificate) {
  auto certificate = read_certificate(pem_certificate);
  if (!certificate) return certificate.error();
  return make_verifier(library, certificate->get());
}

}  // namespace ledgerline::crypto
