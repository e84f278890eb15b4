#include "tools/launcher/configs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::fly {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t phrase_bytes = 8;  // PBKDF2 makes each guess cost some hundred milliseconds

Result<MadeOperator> make_operator(const RunFiles& files, const crypto::KeyAndCertificate& ca,
                                   const std::string& name) {
  MadeOperator made{.name = name,
                    .certificate = files.in(fmt::format("operators/{0}/signcerts/{0}-cert.pem", name)),
                    .pass_phrase = crypto::hex(crypto::random_bytes(phrase_bytes))};
  const auto issued = crypto::issue(
      ca, {.common_name = name + "@org2.ledgerline", .organization = "org2.ledgerline", .unit = "client", .sans = {}});
  if (!issued) return issued.error();
  const auto locked = crypto::lock_key(issued->key_pem, made.pass_phrase);
  if (!locked) return locked.error();
  const std::string folder = files.in("operators/" + name);
  for (const char* part : {"/signcerts", "/keystore"}) {
    std::error_code error;
    fs::create_directories(folder + part, error);
    if (error) return Error{fmt::format("{}{}: {}", folder, part, error.message())};
  }
  Status written = replace_file(made.certificate, issued->certificate_pem, 0644);
  if (written) written = replace_file(folder + "/keystore/priv_sk", *locked, 0600);
  if (!written) return written.error();
  return made;
}

}  // namespace

bool is_operator_name(const std::string& name) {
  constexpr std::size_t max_chars = 32;
  return !name.empty() && name.size() <= max_chars &&
         std::all_of(name.begin(), name.end(), [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); });
}

Result<std::vector<MadeOperator>> make_operators(const RunFiles& files, const std::vector<std::string>& names) {
  const std::string authority = files.in("ledger/crypto/peerOrganizations/org2.ledgerline/ca");
  const auto key = read_file(authority + "/priv_sk");
  const auto certificate = read_file(authority + "/ca.org2.ledgerline-cert.pem");
  if (!key || !certificate) return (key ? certificate : key).error();
  std::vector<MadeOperator> all;
  for (const std::string& name : names) {
    auto made = make_operator(files, {*key, *certificate}, name);
    if (!made) return Error{fmt::format("operator {}: {}", name, made.error().message)};
    all.push_back(std::move(*made));
  }
  return all;
}

}  // namespace ledgerline::fly
