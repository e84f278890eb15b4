#include "tools/checks/shell/probes.hpp"

#include <fmt/format.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.hpp"
#include "common/common.pb.h"
#include "common/fabric/validation/channel_config.hpp"

namespace ledgerline::checks {
namespace {

bool is_open(const std::string& file) {
  struct stat info {};
  return ::stat(file.c_str(), &info) == 0 && !is_private(info);
}

std::string this_user() {
  const passwd* const entry = ::getpwuid(::geteuid());
  return entry ? entry->pw_name : std::to_string(::geteuid());
}

}  // namespace

IdentityFacts read_identity(const LedgerKeys& keys) {
  IdentityFacts facts{.msp_id = keys.msp_id, .place = keys.msp_dir.empty() ? keys.certificate : keys.msp_dir};
  facts.user = this_user();
  facts.msp_dir = keys.msp_dir;
  facts.channel = keys.channel;
  crypto::IdentityFiles files{keys.certificate, keys.private_key};
  if (!keys.msp_dir.empty()) {
    const auto certificate = crypto::certificate_file(keys.msp_dir), key = crypto::key_file(keys.msp_dir);
    if (!certificate) facts.no_certificate = certificate.error().message;
    if (!key) facts.no_key = key.error().message;
    for (const std::string& folder : {keys.msp_dir + "/signcerts", keys.msp_dir + "/keystore"})
      if (is_forbidden(folder)) facts.forbidden = keys.msp_dir;
    if (!certificate || !key) return facts;
    // Of two keys the one that the certificate is of, as programs take it.
    if (auto pair = crypto::identity_files(keys.msp_dir)) files = std::move(*pair);
  }
  if (is_forbidden(files.private_key) || is_forbidden(files.certificate)) facts.forbidden = facts.place;
  facts.certificate_file = files.certificate;
  facts.key_file = files.private_key;
  if (auto certificate = read_file(files.certificate))
    facts.certificate_pem = std::move(*certificate);
  else
    facts.no_certificate = certificate.error().message;
  facts.key_is_open = is_open(files.private_key);
  if (auto key = read_file(files.private_key))
    facts.key_pem = std::move(*key);
  else
    facts.no_key = key.error().message;
  return facts;
}

AnchorFacts read_anchor(const LedgerKeys& keys, const std::string& program, Findings& findings) {
  constexpr const char* check = "trust";
  AnchorFacts facts;
  if (keys.config_block.empty()) {
    findings.push_back(found(Problem::anchor_missing, check, program));
    return facts;
  }
  const auto wrong = [&](const std::string& why) {
    findings.push_back(
        found(Problem::anchor_wrong, check, fmt::format("{} of {}: {}", keys.config_block, program, why)));
  };
  auto bytes = read_file(keys.config_block);
  common::Block block;
  if (!bytes) return wrong(bytes.error().message), facts;
  if (!block.ParseFromString(*bytes)) return wrong("it is no block"), facts;
  const auto config = fabric::read_channel_config(block);
  if (!config) return wrong(config.error().message), facts;
  if (config->channel != keys.channel)
    return wrong(fmt::format("it is of channel {}, not {}", config->channel, keys.channel)), facts;
  for (const crypto::MspRoot& one : config->organisations) facts.organisations.push_back({one.msp_id, one.ca_pem});
  facts.embedded = config->embedded_node;
  facts.block = std::move(*bytes);
  return facts;
}

TrustFacts read_trust(const LedgerKeys& keys, const std::string& program, const AnchorFacts& anchor) {
  TrustFacts facts{program, {}, anchor.organisations};
  for (const auto& [id, file] : keys.msps) {
    TrustFacts::Msp msp{id, file};
    auto pem = read_file(file);
    if (is_forbidden(file)) {
      msp.problem = Problem::file_forbidden;
      msp.why = file;
      msp.cure = let_all_read(file);
    } else if (!pem) {
      msp.why = pem.error().message;
    } else if (is_der(*pem)) {
      msp.problem = Problem::not_pem;
      msp.why = file;
      msp.cure = cure_of_der(file);
    } else if (auto certificate = crypto::parse_certificate(*pem); !certificate) {
      msp.why = fmt::format("{}: {}", file, certificate.error().message);
    } else {
      msp.pem = std::move(*pem);
    }
    facts.msps.push_back(std::move(msp));
  }
  return facts;
}

}  // namespace ledgerline::checks
