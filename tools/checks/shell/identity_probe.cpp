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

IdentityInputs read_identity(const LedgerKeys& keys) {
  IdentityInputs inputs{.msp_id = keys.msp_id, .place = keys.msp_dir.empty() ? keys.certificate : keys.msp_dir};
  inputs.user = this_user();
  inputs.msp_dir = keys.msp_dir;
  inputs.channel = keys.channel;
  crypto::IdentityFiles files{keys.certificate, keys.private_key};
  if (!keys.msp_dir.empty()) {
    const auto certificate = crypto::certificate_file(keys.msp_dir), key = crypto::key_file(keys.msp_dir);
    if (!certificate) inputs.no_certificate = certificate.error().message;
    if (!key) inputs.no_key = key.error().message;
    for (const std::string& folder : {keys.msp_dir + "/signcerts", keys.msp_dir + "/keystore"})
      if (is_forbidden(folder)) inputs.forbidden = keys.msp_dir;
    if (!certificate || !key) return inputs;
    // Of two keys the one that the certificate is of, as programs take it.
    if (auto pair = crypto::identity_files(keys.msp_dir)) files = std::move(*pair);
  }
  if (is_forbidden(files.private_key) || is_forbidden(files.certificate)) inputs.forbidden = inputs.place;
  inputs.certificate_file = files.certificate;
  inputs.key_file = files.private_key;
  if (auto certificate = read_file(files.certificate))
    inputs.certificate_pem = std::move(*certificate);
  else
    inputs.no_certificate = certificate.error().message;
  inputs.key_is_open = is_open(files.private_key);
  if (auto key = read_file(files.private_key))
    inputs.key_pem = std::move(*key);
  else
    inputs.no_key = key.error().message;
  return inputs;
}

AnchorInputs read_anchor(const LedgerKeys& keys, const std::string& program, Findings& findings) {
  constexpr const char* check = "trust";
  AnchorInputs inputs;
  if (keys.config_block.empty()) {
    findings.push_back(flag(Problem::anchor_missing, check, program));
    return inputs;
  }
  const auto wrong = [&](const std::string& why) {
    findings.push_back(
        flag(Problem::anchor_wrong, check, fmt::format("{} of {}: {}", keys.config_block, program, why)));
  };
  auto bytes = read_file(keys.config_block);
  common::Block block;
  if (!bytes) return wrong(bytes.error().message), inputs;
  if (!block.ParseFromString(*bytes)) return wrong("it is no block"), inputs;
  const auto config = fabric::read_channel_config(block);
  if (!config) return wrong(config.error().message), inputs;
  if (config->channel != keys.channel)
    return wrong(fmt::format("it is of channel {}, not {}", config->channel, keys.channel)), inputs;
  for (const crypto::MspRoot& one : config->organisations) inputs.organisations.push_back({one.msp_id, one.ca_pem});
  inputs.embedded = config->embedded_node;
  inputs.block = std::move(*bytes);
  return inputs;
}

TrustInputs read_trust(const LedgerKeys& keys, const std::string& program, const AnchorInputs& anchor) {
  TrustInputs inputs{program, {}, anchor.organisations};
  for (const auto& [id, file] : keys.msps) {
    TrustInputs::Msp msp{id, file};
    auto pem = read_file(file);
    if (is_forbidden(file)) {
      msp.problem = Problem::file_forbidden;
      msp.why = file;
      msp.cure = cure_of_forbidden(file);
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
    inputs.msps.push_back(std::move(msp));
  }
  return inputs;
}

}  // namespace ledgerline::checks
