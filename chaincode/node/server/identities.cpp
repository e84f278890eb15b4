#include "chaincode/node/server/identities.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace ledgerline::node {
namespace {

namespace fs = std::filesystem;
constexpr int organisation_count = 3;

Status write_file(const fs::path& path, const std::string& content, int mode) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  if (error) return Error{"making " + path.parent_path().string() + ": " + error.message()};
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, mode);
  if (fd < 0) return Error{"opening " + path.string() + ": " + std::strerror(errno)};
  const bool written = ::write(fd, content.data(), content.size()) == static_cast<ssize_t>(content.size());
  const bool synced = written && ::fsync(fd) == 0;
  const std::string why = synced ? "" : std::strerror(errno);
  ::close(fd);
  if (!synced) return Error{"writing " + path.string() + ": " + why};
  return done;
}

// All names under `dir`, and its own, survive a loss of power from here on; done once, at the first start.
Status sync_file_system(const std::string& dir) {
  const int fd = ::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = fd >= 0 && ::syncfs(fd) == 0;
  const std::string why = synced ? "" : std::strerror(errno);
  if (fd >= 0) ::close(fd);
  if (!synced) return Error{"syncing " + dir + ": " + why};
  return done;
}

Status write_public(const fs::path& path, const std::string& content) { return write_file(path, content, 0644); }
Status write_secret(const fs::path& path, const std::string& content) { return write_file(path, content, 0600); }

Result<std::string> read_file(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream content;
  if (!in || !(content << in.rdbuf())) return Error{"cannot read " + path.string()};
  return content.str();
}

std::string domain_of(int organisation) { return "org" + std::to_string(organisation) + ".ledgerline"; }
std::string msp_id_of(int organisation) { return "Org" + std::to_string(organisation) + "MSP"; }
fs::path peer_org_dir(const fs::path& crypto, int organisation) {
  return crypto / "peerOrganizations" / domain_of(organisation);
}

/// Writes one organisation's files; the first failure stops it and is kept.
class Organisation {
 public:
  Organisation(fs::path root, std::string domain) : root_(std::move(root)), domain_(std::move(domain)) {}

  Status make_authorities() {
    for (auto [name, authority] : {std::pair{"ca", &ca_}, std::pair{"tlsca", &tls_ca_}}) {
      const std::string common_name = std::string(name) + "." + domain_;
      auto made = crypto::make_ca(common_name, domain_);
      if (!made) return made.error();
      *authority = std::move(*made);
      if (Status s = write_public(root_ / name / (common_name + "-cert.pem"), authority->certificate_pem); !s) return s;
      if (Status s = write_secret(root_ / name / "priv_sk", authority->key_pem); !s) return s;
    }
    return write_msp(root_ / "msp");
  }

  /// `kind`: peers, orderers or users. `tls_name`: server or client.
  Status make_member(const std::string& kind, const std::string& name, const std::string& unit,
                     const std::vector<std::string>& sans, const std::string& tls_name) {
    const fs::path dir = root_ / kind / name;
    crypto::CertificateRequest request;
    request.common_name = name;
    request.organization = domain_;
    request.unit = unit;
    const auto identity = crypto::issue(ca_, request);
    if (!identity) return identity.error();
    if (Status s = write_msp(dir / "msp"); !s) return s;
    if (Status s = write_public(dir / "msp" / "signcerts" / (name + "-cert.pem"), identity->certificate_pem); !s)
      return s;
    if (Status s = write_secret(dir / "msp" / "keystore" / "priv_sk", identity->key_pem); !s) return s;
    request.unit.reset();
    request.sans = sans;
    request.tls = true;
    const auto tls = crypto::issue(tls_ca_, request);
    if (!tls) return tls.error();
    if (Status s = write_public(dir / "tls" / "ca.crt", tls_ca_.certificate_pem); !s) return s;
    if (Status s = write_public(dir / "tls" / (tls_name + ".crt"), tls->certificate_pem); !s) return s;
    return write_secret(dir / "tls" / (tls_name + ".key"), tls->key_pem);
  }

 private:
  Status write_msp(const fs::path& msp) const {
    const std::string ca_file = "ca." + domain_ + "-cert.pem";
    if (Status s = write_public(msp / "cacerts" / ca_file, ca_.certificate_pem); !s) return s;
    if (Status s = write_public(msp / "tlscacerts" / ("tlsca." + domain_ + "-cert.pem"), tls_ca_.certificate_pem); !s) {
      return s;
    }
    std::string config = "NodeOUs:\n  Enable: true\n";
    for (const char* unit : {"Client", "Peer", "Admin", "Orderer"}) {
      std::string lower = unit;
      lower[0] = static_cast<char>(lower[0] - 'A' + 'a');
      config += "  " + std::string(unit) + "OUIdentifier:\n    Certificate: cacerts/" + ca_file +
                "\n    OrganizationalUnitIdentifier: " + lower + "\n";
    }
    return write_public(msp / "config.yaml", config);
  }

  fs::path root_;
  std::string domain_;
  crypto::KeyAndCertificate ca_, tls_ca_;
};

Status make_peer_organisation(const fs::path& crypto, int number) {
  const std::string domain = domain_of(number);
  Organisation organisation(peer_org_dir(crypto, number), domain);
  if (Status s = organisation.make_authorities(); !s) return s;
  const std::string peer = "peer0." + domain;
  if (Status s = organisation.make_member("peers", peer, "peer", {peer, "localhost", "127.0.0.1"}, "server"); !s)
    return s;
  for (const char* user : {"Admin", "User1", "User2"}) {
    const std::string name = std::string(user) + "@" + domain;
    const std::string unit = std::string(user) == "Admin" ? "admin" : "client";
    if (Status s = organisation.make_member("users", name, unit, {}, "client"); !s) return s;
  }
  return done;
}

Status make_identities(const fs::path& crypto) {
  for (int number = 1; number <= organisation_count; ++number) {
    if (Status s = make_peer_organisation(crypto, number); !s) return s;
  }
  Organisation orderers(crypto / "ordererOrganizations" / "ledgerline", "ledgerline");
  if (Status s = orderers.make_authorities(); !s) return s;
  if (Status s = orderers.make_member("users", "Admin@ledgerline", "admin", {}, "client"); !s) return s;
  const std::string name = "orderer.ledgerline";
  return orderers.make_member("orderers", name, "orderer", {name, "localhost", "127.0.0.1"}, "server");
}

}  // namespace

std::string user_msp_dir(const std::string& dir, int organisation, const std::string& user) {
  return peer_org_dir(fs::path(dir) / "crypto", organisation) / "users" / (user + "@" + domain_of(organisation)) /
         "msp";
}

Result<Identities> open_identities(const std::string& dir) {
  const fs::path crypto = fs::path(dir) / "crypto";
  if (!fs::exists(crypto)) {
    std::error_code error;
    if (const fs::path blocks = fs::path(dir) / "ledger" / "blocks";
        fs::exists(blocks) && fs::file_size(blocks, error) > 0) {
      return Error{crypto.string() + " is missing, but " + blocks.string() +
                   " holds blocks signed under it. Restore it from a copy, or begin in an empty directory"};
    }
    const fs::path unfinished = fs::path(dir) / "crypto.unfinished";
    fs::remove_all(unfinished, error);
    if (error) return Error{"removing " + unfinished.string() + ": " + error.message()};
    if (Status s = make_identities(unfinished); !s) return s.error();
    fs::rename(unfinished, crypto, error);
    if (error) return Error{"renaming " + unfinished.string() + ": " + error.message()};
    if (Status s = sync_file_system(dir); !s) return s.error();
  }
  Identities identities;
  for (int number = 1; number <= organisation_count; ++number) {
    const fs::path root = peer_org_dir(crypto, number);
    const auto ca = read_file(root / "ca" / ("ca." + domain_of(number) + "-cert.pem"));
    if (!ca) return ca.error();
    identities.organisations.push_back({msp_id_of(number), *ca});
    const fs::path peer = root / "peers" / ("peer0." + domain_of(number));
    auto identity = crypto::load_identity(crypto::Library::libcrypto, msp_id_of(number), peer / "msp");
    if (!identity) return identity.error();
    identities.peers.push_back(std::move(*identity));
    if (number > 1) continue;
    const auto key = read_file(peer / "tls" / "server.key");
    const auto certificate = read_file(peer / "tls" / "server.crt");
    if (!key) return key.error();
    if (!certificate) return certificate.error();
    identities.server_key_pem = *key;
    identities.server_certificate_pem = *certificate;
  }
  const fs::path orderer = crypto / "ordererOrganizations" / "ledgerline" / "orderers" / "orderer.ledgerline" / "msp";
  auto identity = crypto::load_identity(crypto::Library::libcrypto, "OrdererMSP", orderer);
  if (!identity) return identity.error();
  identities.orderer = std::move(*identity);
  return identities;
}

}  // namespace ledgerline::node
