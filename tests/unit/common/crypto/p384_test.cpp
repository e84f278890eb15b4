#include <gtest/gtest.h>

#include "common/crypto/crypto.hpp"
#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

// RFC 6979, A.2.6: the P-384 key as SEC1, and a certificate over it by the openssl CLI.
constexpr char rfc6979_p384_key[] =
    "-----BEGIN EC PRIVATE KEY-----\n"
    "MIGkAgEBBDBrnT2tLhuMHAWxmHW2ZZ9N4jw7Znvyl7qapHdAeHE32JbVck5McKgl\n"
    "+HLJ6mDS7fWgBwYFK4EEACKhZANiAATsOk5BW04ZpFaGGAKfQn+l2pqLxK6S4C4G\n"
    "quUoazAMZN748OqQVYZgZKJUUVSAvBOAFdm3LX1XJE6o75rAxiGJZwilk2f537n1\n"
    "TKhLPxydsSiLIxw64NT+c0T9JTMmRyA=\n"
    "-----END EC PRIVATE KEY-----\n";
constexpr char rfc6979_p384_certificate[] =
    "-----BEGIN CERTIFICATE-----\n"
    "MIIBwTCCAUigAwIBAgIUJvUV+VJO+0yYD+rmPFtbzbMy8a8wCgYIKoZIzj0EAwIw\n"
    "FzEVMBMGA1UEAwwMcmZjNjk3OS1wMzg0MCAXDTI2MTEyNjE5Mjk1OFoYDzIxMjYx\n"
    "MTAyMTkyOTU4WjAXMRUwEwYDVQQDDAxyZmM2OTc5LXAzODQwdjAQBgcqhkjOPQIB\n"
    "BgUrgQQAIgNiAATsOk5BW04ZpFaGGAKfQn+l2pqLxK6S4C4GquUoazAMZN748OqQ\n"
    "VYZgZKJUUVSAvBOAFdm3LX1XJE6o75rAxiGJZwilk2f537n1TKhLPxydsSiLIxw6\n"
    "4NT+c0T9JTMmRyCjUzBRMB0GA1UdDgQWBBRgKtQOGFfvMEzSzuEKnHaL2tDa2jAf\n"
    "BgNVHSMEGDAWgBRgKtQOGFfvMEzSzuEKnHaL2tDa2jAPBgNVHRMBAf8EBTADAQH/\n"
    "MAoGCCqGSM49BAMCA2cAMGQCMDLDcxqRdGxyh57lKSpWfwnrcy1rPE04I/uzlnC6\n"
    "zyjS7eLDkfnjlVz/IO2EKgUS0QIwDQfd2ZUkkijScwcV3qYR0tEi2DBUlMflYxM3\n"
    "Y24lPjHM993JtX8fy0nn7nyWi9bz\n"
    "-----END CERTIFICATE-----\n";
// The RFC's signatures with SHA-256, which Fabric uses on this curve, too. That of "sample" has s above n/2.
constexpr char p384_sample_r[] =
    "21b13d1e013c7fa1392d03c5f99af8b30c570c6f98d4ea8e354b63a21d3daa33bde1e888e63355d92fa2b3c36d8fb2cd";
constexpr char p384_sample_s_high[] =
    "f3aa443fb107745bf4bd77cb3891674632068a10ca67e3d45db2266fa7d1feebefdc63eccd1ac42ec0cb8668a4fa0ab0";
constexpr char p384_sample_s_low[] =
    "0c55bbc04ef88ba40b428834c76e98b9cdf975ef35981c2b69b127124c652ef3683da9c57b95e34c2c20930227cb1ec3";
constexpr char p384_test_r[] =
    "6d6defac9ab64dabafe36c6bf510352a4cc27001263638e5b16d9bb51d451559f918eedaf2293be5b475cc8f0188636b";
constexpr char p384_test_s[] =
    "2d46f3becbcc523d5f1a1256bf0c9b024d879ba9e838144c8ba6baeb4b53b47d51ab373f9845c0514eefb14024787265";
constexpr char p384_half_order[] =
    "7fffffffffffffffffffffffffffffffffffffffffffffffe3b1a6c0fa1b96efac0d06d9245853bd76760cb5666294b9";

std::string p384_der(std::string_view r_hex, std::string_view s_hex) {
  std::string body;
  for (const std::string_view number_hex : {r_hex, s_hex}) {
    std::string number;
    for (std::size_t i = 0; i + 1 < number_hex.size(); i += 2)
      number.push_back(static_cast<char>(std::stoi(std::string(number_hex.substr(i, 2)), nullptr, 16)));
    if ((static_cast<unsigned char>(number[0]) & 0x80) != 0) number.insert(number.begin(), '\0');
    body += std::string{0x02, static_cast<char>(number.size())} + number;
  }
  return std::string{0x30, static_cast<char>(body.size())} + body;
}

constexpr Library both[] = {Library::mbedtls, Library::libcrypto};

TEST(SignatureOfP384, MbedtlsMakesTheRfcsSignatures) {
  const auto signer = make_signer(Library::mbedtls, rfc6979_p384_key).value();
  EXPECT_EQ(hex(signer->sign("sample").value()), hex(p384_der(p384_sample_r, p384_sample_s_low)));
  EXPECT_EQ(hex(signer->sign("test").value()), hex(p384_der(p384_test_r, p384_test_s)));
}

TEST(SignatureOfP384, BothLibrariesAcceptTheLowAndRefuseTheHighOne) {
  for (const Library library : both) {
    const auto verifier = make_verifier(library, rfc6979_p384_certificate).value();
    EXPECT_TRUE(verifier->verify("sample", p384_der(p384_sample_r, p384_sample_s_low)));
    EXPECT_TRUE(verifier->verify("test", p384_der(p384_test_r, p384_test_s)));
    EXPECT_FALSE(verifier->verify("sample", p384_der(p384_sample_r, p384_sample_s_high)));
    EXPECT_FALSE(verifier->verify("Sample", p384_der(p384_sample_r, p384_sample_s_low)));
  }
}

TEST(SignatureOfP384, EachLibraryAcceptsTheOthersAndNoChangedBit) {
  for (const Library signs : both) {
    const auto signer = make_signer(signs, rfc6979_p384_key).value();
    for (int i = 0; i < 20; ++i) {
      const std::string message = "message " + std::to_string(i);
      const std::string good = signer->sign(message).value();
      EXPECT_TRUE(decode_signature(good, Curve::p384)) << hex(good);
      for (const Library checks : both) {
        const auto verifier = make_verifier(checks, rfc6979_p384_certificate).value();
        EXPECT_TRUE(verifier->verify(message, good));
        std::string bad = good;
        bad[static_cast<std::size_t>(i) * 5 % bad.size()] ^= 4;
        EXPECT_FALSE(verifier->verify(message, bad));
      }
    }
  }
}

TEST(SignatureOfP384, HalfItsOrderIsTheBorder) {
  const std::string half = p384_half_order;
  EXPECT_TRUE(decode_signature(p384_der("01", half), Curve::p384));
  EXPECT_FALSE(decode_signature(p384_der("01", half.substr(0, 94) + "ba"), Curve::p384));
  EXPECT_FALSE(decode_signature(p384_der("01", half), Curve::p256)) << "too long for the other curve";
  EcdsaSignature border = *decode_signature(p384_der("01", half), Curve::p384);
  ++border.s[47];  // n/2 + 1 becomes n/2
  EXPECT_EQ(hex(encode_signature(border, Curve::p384)), hex(p384_der("01", half)));
}

}  // namespace
}  // namespace ledgerline::crypto
