#include <gtest/gtest.h>
#include <pthread.h>

#include <chrono>
#include <cstdlib>
#include <future>
#include <thread>

#include "common/crypto/crypto.hpp"
#include "common/crypto/openssl.hpp"

namespace ledgerline::crypto {
namespace {

// RFC 6979, A.2.5: the P-256 key as SEC1 (openssl ec -conv_form ...), and a certificate over it by the openssl CLI.
constexpr char rfc6979_key[] =
    "-----BEGIN EC PRIVATE KEY-----\n"
    "MHcCAQEEIMmvqdhFunUWa1whV2ex1pNOUMPbNuibEnuKYisSD2choAoGCCqGSM49\n"
    "AwEHoUQDQgAEYP7UuiVanTHJYet0xjVtaMBJuJI7Yfps5mliLmDyn7Z5A/4QCLi8\n"
    "maQa6elWKLxk8vGyDC1+n1F3o8KU1EYimQ==\n"
    "-----END EC PRIVATE KEY-----\n";
constexpr char rfc6979_key_pkcs8[] =
    "-----BEGIN PRIVATE KEY-----\n"
    "MIGHAgEAMBMGByqGSM49AgEGCCqGSM49AwEHBG0wawIBAQQgya+p2EW6dRZrXCFX\n"
    "Z7HWk05Qw9s26JsSe4piKxIPZyGhRANCAARg/tS6JVqdMclh63TGNW1owEm4kjth\n"
    "+mzmaWIuYPKftnkD/hAIuLyZpBrp6VYovGTy8bIMLX6fUXejwpTURiKZ\n"
    "-----END PRIVATE KEY-----\n";
constexpr char rfc6979_certificate[] =
    "-----BEGIN CERTIFICATE-----\n"
    "MIIBezCCASGgAwIBAgIUJnhiFPqRCYt0exGc+3cOwpKLQ04wCgYIKoZIzj0EAwIw\n"
    "EjEQMA4GA1UEAwwHcmZjNjk3OTAgFw0yNjExMjExMjAwNDVaGA8yMTI2MTAyODEy\n"
    "MDA0NVowEjEQMA4GA1UEAwwHcmZjNjk3OTBZMBMGByqGSM49AgEGCCqGSM49AwEH\n"
    "A0IABGD+1LolWp0xyWHrdMY1bWjASbiSO2H6bOZpYi5g8p+2eQP+EAi4vJmkGunp\n"
    "Vii8ZPLxsgwtfp9Rd6PClNRGIpmjUzBRMB0GA1UdDgQWBBQalWlXm84ympQtB2nJ\n"
    "wLVkMVY3EDAfBgNVHSMEGDAWgBQalWlXm84ympQtB2nJwLVkMVY3EDAPBgNVHRMB\n"
    "Af8EBTADAQH/MAoGCCqGSM49BAMCA0gAMEUCIDW8YmAmXEEyIUkIaPTJ0JBb9w3P\n"
    "MuXDNosXgVnV7LhYAiEAxzLTFmtB6dapDNI6yW+iuH4q8et4fIOXTNIAF/xj1kA=\n"
    "-----END CERTIFICATE-----\n";
// The RFC's signature of "sample" with SHA-256; its s is above n/2, so what we write has n - s.
constexpr char sample_r[] = "efd48b2aacb6a8fd1140dd9cd45e81d69d2c877b56aaf991c34d0ea84eaf3716";
constexpr char sample_s_high[] = "f7cb1c942d657c41d436c7a1b6e29f65f3e900dbb9aff4064dc4ab2f843acda8";
constexpr char sample_s_low[] = "0834e36ad29a83bf2bc9385e491d6099c8fdf9d1ed67aa7ea5f51f93782857a9";
// Of "test": here s is low already.
constexpr char test_r[] = "f1abb023518351cd71d881567b1ea663ed3efcf6c5132b354f28d3b0b7d38367";
constexpr char test_s[] = "019f4113742a2b14bd25926b49c649155f267e60d3814b4c0cc84250e46f0083";

/// DER as the RFC's numbers give it, without lowering s.
std::string der_of(std::string_view r_hex, std::string_view s_hex) {
  std::string body;
  for (const std::string& number : {unhex(r_hex).value(), unhex(s_hex).value()}) {
    const bool pad = (static_cast<unsigned char>(number[0]) & 0x80) != 0;
    body += std::string{0x02, static_cast<char>(number.size() + (pad ? 1 : 0))} + (pad ? std::string(1, '\0') : "") +
            number;
  }
  return std::string{0x30, static_cast<char>(body.size())} + body;
}

constexpr Library libraries[] = {Library::mbedtls, Library::libcrypto};

std::unique_ptr<Signer> signer_of(Library library, const std::string& key) { return make_signer(library, key).value(); }
std::unique_ptr<Verifier> verifier_of(Library library, const std::string& certificate) {
  return make_verifier(library, certificate).value();
}

TEST(Hash, KnownVectors) {
  EXPECT_EQ(hex(sha256("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(hex(sha256("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(hex(std::string_view("\x00\x7f\xff", 3)), "007fff");
}

TEST(Signature, MbedtlsMakesTheRfcsSignatures) {
  for (const char* key : {rfc6979_key, rfc6979_key_pkcs8}) {
    const auto signer = signer_of(Library::mbedtls, key);
    EXPECT_EQ(hex(signer->sign("sample").value()), hex(der_of(sample_r, sample_s_low)));
    EXPECT_EQ(hex(signer->sign("test").value()), hex(der_of(test_r, test_s)));
  }
}

TEST(Signature, BothLibrariesAcceptTheLowAndRefuseTheHighOne) {
  for (const Library library : libraries) {
    const auto verifier = verifier_of(library, rfc6979_certificate);
    EXPECT_TRUE(verifier->verify("sample", der_of(sample_r, sample_s_low)));
    EXPECT_TRUE(verifier->verify("test", der_of(test_r, test_s)));
    EXPECT_FALSE(verifier->verify("sample", der_of(sample_r, sample_s_high)));
    EXPECT_FALSE(verifier->verify("Sample", der_of(sample_r, sample_s_low)));
  }
}

TEST(Signature, EachLibraryAcceptsTheOthers) {
  const auto ca = make_ca("ca.test", "test").value();
  const auto user =
      issue(ca, {.common_name = "User1@test", .organization = "test", .unit = "client", .sans = {}}).value();
  for (const Library signs : libraries) {
    for (const std::string& key : {user.key_pem, std::string(rfc6979_key)}) {
      const auto signer = signer_of(signs, key);
      const std::string& certificate = key == user.key_pem ? user.certificate_pem : rfc6979_certificate;
      for (int i = 0; i < 40; ++i) {  // both shapes of r and s come up
        const std::string message = "message " + std::to_string(i) + std::string(static_cast<std::size_t>(i * 37), 'x');
        const std::string signature = signer->sign(message).value();
        EXPECT_TRUE(decode_signature(signature, Curve::p256)) << hex(signature);
        for (const Library checks : libraries)
          EXPECT_TRUE(verifier_of(checks, certificate)->verify(message, signature));
      }
    }
  }
}

TEST(Signature, AnyChangedBitIsRefused) {
  const std::string good = signer_of(Library::libcrypto, rfc6979_key)->sign("message").value();
  for (const Library library : libraries) {
    const auto verifier = verifier_of(library, rfc6979_certificate);
    for (std::size_t bit = 0; bit < good.size() * 8; bit += 5) {
      std::string bad = good;
      bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << (bit % 8)));
      EXPECT_FALSE(verifier->verify("message", bad)) << "bit " << bit;
    }
  }
}

TEST(Signature, MalformedDerIsRefused) {
  const std::string good = der_of(test_r, test_s);
  std::vector<std::string> bad{"",
                               "0",
                               std::string("\x30\x00", 2),
                               good + '\0',
                               std::string("\x30\x06\x02\x01\x00\x02\x01\x00", 8),
                               std::string("\x30\x06\x02\x01\xff\x02\x01\x01", 8)};
  for (std::size_t cut = 0; cut < good.size(); ++cut) bad.push_back(good.substr(0, cut));
  std::string padded = der_of(test_r, "00" + std::string(test_s));  // not the shortest form
  bad.push_back(padded);
  // r = n and s = 1: out of range.
  bad.push_back(der_of("ffffffff00000000ffffffffffffffffbce6faada7179e84f3b9cac2fc632551", "01"));
  for (const std::string& der : bad) {
    EXPECT_FALSE(decode_signature(der, Curve::p256)) << hex(der);
    for (const Library library : libraries)
      EXPECT_FALSE(verifier_of(library, rfc6979_certificate)->verify("test", der));
  }
}

TEST(Signature, HalfTheOrderIsTheBorder) {
  const std::string half = "7fffffff800000007fffffffffffffffde737d56d38bcf4279dce5617e3192a8";
  EXPECT_TRUE(decode_signature(der_of("01", half), Curve::p256));
  EXPECT_FALSE(
      decode_signature(der_of("01", "7fffffff800000007fffffffffffffffde737d56d38bcf4279dce5617e3192a9"), Curve::p256));
  EcdsaSignature border = *decode_signature(der_of("01", half), Curve::p256);
  ++border.s[47];  // n/2 + 1 becomes n/2
  EXPECT_EQ(hex(encode_signature(border, Curve::p256)), hex(der_of("01", half)));
}

TEST(Signature, ManyThreadsMayUseOneSignerAndOneVerifier) {
  for (const Library library : libraries) {
    const auto signer = signer_of(library, rfc6979_key);
    const auto verifier = verifier_of(library, rfc6979_certificate);
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&, t] {
        for (int i = 0; i < 20; ++i) {
          const std::string message = std::to_string(t * 1000 + i);
          EXPECT_TRUE(verifier->verify(message, signer->sign(message).value()));
        }
      });
    }
    for (auto& thread : threads) thread.join();
  }
}

TEST(Key, WhatIsNoKeyOfTheTwoCurvesIsRefused) {
  constexpr char p521[] =
      "-----BEGIN PRIVATE KEY-----\n"
      "MIHuAgEAMBAGByqGSM49AgEGBSuBBAAjBIHWMIHTAgEBBEIB06GvL7LEK//lCMX3\n"
      "Y+3oYH9xsG1Keu6Mg+Mx4Gf4ayuon/KNSYYR9KK8yQ5SyzHeYMw21KQXfTSLqAVL\n"
      "3oJxRP+hgYkDgYYABADQg/DL3xgEEElDyLc671nXrZnnZT9Md3Yl87Cer1wPYfah\n"
      "y1F2n6cYWV0fhLKMWk+gWkdJvig/V3wuSQBWBEqZJgBXPmV6jYdqQiBa4s+r5/RS\n"
      "jcs4cwkTmaSEk4+uVUuzH601ai39JnBqrwYbqNO3OhtM+THFPKm7B+kivp4PKOQe\n"
      "/A==\n"
      "-----END PRIVATE KEY-----\n";
  for (const Library library : libraries) {
    EXPECT_FALSE(make_signer(library, p521));
    EXPECT_FALSE(make_signer(library, ""));
    EXPECT_FALSE(make_signer(library, "-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n"));
    EXPECT_FALSE(make_verifier(library, "not a certificate"));
  }
}

TEST(Random, BytesDiffer) {
  EXPECT_EQ(random_bytes(24).size(), 24U);
  EXPECT_NE(random_bytes(24), random_bytes(24));
}

/// Ends late where a test asks for it: made before anything of libcrypto, so it goes after all of that.
struct LateEnd {
  ~LateEnd() { std::this_thread::sleep_for(wait); }
  std::chrono::milliseconds wait{0};
} late_end;

/// gRPC's threads are never joined, and sign: a process ends while one of them is just ending. The sanitizer's build
/// sees what is lost then.
TEST(ExitDeathTest, AThreadThatIsJustEndingLosesNothing) {
  EXPECT_EXIT(
      {
        pthread_key_t key = 0;
        pthread_key_create(&key, [](void*) { std::this_thread::sleep_for(std::chrono::milliseconds(100)); });
        std::promise<bool> used;
        std::thread([&] {
          pthread_setspecific(key, &used);
          used.set_value((*make_signer(Library::libcrypto, rfc6979_key))->sign("sample").ok());
        }).detach();
        late_end.wait = std::chrono::milliseconds(300);
        std::exit(used.get_future().get() ? 0 : 3);
      },
      ::testing::ExitedWithCode(0), "");
}

TEST(Base64, IsDecodedOrRefused) {
  EXPECT_EQ(unbase64("YQ=="), "a");
  EXPECT_EQ(unbase64("YWI=\n"), "ab");
  EXPECT_EQ(unbase64("YWJj\r\nYWJj"), "abcabc");
  for (const char* none : {"", "YQ", "-----BEGIN A-----", "Y$=="}) EXPECT_FALSE(unbase64(none)) << none;
}

}  // namespace
}  // namespace ledgerline::crypto
