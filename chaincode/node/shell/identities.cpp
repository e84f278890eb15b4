#include "chaincode/node/shell/identities.hpp"

#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

namespace fs = std::filesystem;

std::string user_msp_dir(const std::string& dir, int organisation, const std::string& user) {
  return identities::user_dir(dir, organisation, user) / "msp";
}

Result<Identities> open_identities(const std::string& dir) {
  const fs::path crypto = fs::path(dir) / "crypto", blocks = fs::path(dir) / "ledger" / "blocks";
  std::error_code error;
  if (!fs::exists(crypto) && fs::exists(blocks) && fs::file_size(blocks, error) > 0) {
    return Error{crypto.string() + " is missing, but " + blocks.string() +
                 " holds blocks signed under it. Restore it from a copy, or begin in an empty directory"};
  }
  if (Status made = identities::make(dir, 1); !made) return made.error();
  Identities all;
  for (int number = 1; number <= identities::organisations; ++number) {
    const std::string msp_id = identities::msp_id_of(number);
    const auto ca = read_file(identities::organisation_dir(dir, number) / "ca" /
                              ("ca." + identities::domain_of(number) + "-cert.pem"));
    if (!ca) return ca.error();
    all.organisations.push_back({msp_id, *ca});
    const fs::path peer = identities::peer_dir(dir, number);
    auto identity = crypto::load_identity(crypto::Library::libcrypto, msp_id, peer / "msp");
    if (!identity) return identity.error();
    all.peers.push_back(std::move(*identity));
    const auto key = crypto::read_key_file(peer / "tls" / "server.key");
    const auto certificate = read_file(peer / "tls" / "server.crt");
    if (!key) return key.error();
    if (!certificate) return certificate.error();
    all.tls.push_back({*key, *certificate});
  }
  auto identity =
      crypto::load_identity(crypto::Library::libcrypto, "OrdererMSP", identities::orderer_dir(dir, 1) / "msp");
  if (!identity) return identity.error();
  all.orderer = std::move(*identity);
  const auto ca = read_file(identities::ordering_dir(dir) / "ca" / "ca.ledgerline-cert.pem");
  if (!ca) return ca.error();
  all.orderers = {"OrdererMSP", *ca};
  return all;
}

}  // namespace ledgerline::node
