#include "chaincode/identities/identities.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace ledgerline::identities {
namespace {

namespace fs = std::filesystem;

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

  /// For a server that signs nothing.
  Status make_tls(const std::string& folder, const std::string& name, const std::vector<std::string>& sans) {
    crypto::CertificateRequest request;
    request.common_name = name;
    request.organization = domain_;
    request.sans = sans;
    request.tls = true;
    const auto tls = crypto::issue(tls_ca_, request);
    if (!tls) return tls.error();
    if (Status s = write_public(root_ / folder / "tls" / "server.crt", tls->certificate_pem); !s) return s;
    return write_secret(root_ / folder / "tls" / "server.key", tls->key_pem);
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

std::vector<std::string> names_of_server(const std::string& name, const std::vector<std::string>& hosts, int number) {
  std::vector<std::string> names{name, "localhost", "127.0.0.1"};
  const auto index = static_cast<std::size_t>(number - 1);
  if (index < hosts.size() && hosts[index] != names.back()) names.push_back(hosts[index]);
  return names;
}

Status make_peer_organisation(const fs::path& crypto, int number, const Hosts& hosts) {
  const std::string domain = domain_of(number);
  Organisation organisation(crypto / "peerOrganizations" / domain, domain);
  if (Status s = organisation.make_authorities(); !s) return s;
  const std::string peer = "peer0." + domain;
  if (Status s =
          organisation.make_member("peers", peer, "peer", names_of_server(peer, hosts.organisations, number), "server");
      !s) {
    return s;
  }
  const std::string chaincode = "chaincode." + domain;
  if (Status s = organisation.make_tls("chaincode", chaincode, names_of_server(chaincode, hosts.organisations, number));
      !s) {
    return s;
  }
  for (const char* user : {"Admin", "User1", "User2"}) {
    const std::string name = std::string(user) + "@" + domain;
    const std::string unit = std::string(user) == "Admin" ? "admin" : "client";
    if (Status s = organisation.make_member("users", name, unit, {}, "client"); !s) return s;
  }
  return done;
}

Status make_all(const fs::path& crypto, int orderers, const Hosts& hosts) {
  for (int number = 1; number <= organisations; ++number) {
    if (Status s = make_peer_organisation(crypto, number, hosts); !s) return s;
  }
  Organisation ordering(crypto / "ordererOrganizations" / "ledgerline", "ledgerline");
  if (Status s = ordering.make_authorities(); !s) return s;
  if (Status s = ordering.make_member("users", "Admin@ledgerline", "admin", {}, "client"); !s) return s;
  for (int number = 1; number <= orderers; ++number) {
    const std::string name = orderer_name(number);
    if (Status s =
            ordering.make_member("orderers", name, "orderer", names_of_server(name, hosts.orderers, number), "server");
        !s) {
      return s;
    }
  }
  return done;
}

}  // namespace

std::string domain_of(int organisation) { return "org" + std::to_string(organisation) + ".ledgerline"; }
std::string msp_id_of(int organisation) { return "Org" + std::to_string(organisation) + "MSP"; }
std::string orderer_name(int number) {
  return "orderer" + (number == 1 ? std::string() : std::to_string(number)) + ".ledgerline";
}

fs::path organisation_dir(const std::string& dir, int organisation) {
  return fs::path(dir) / "crypto" / "peerOrganizations" / domain_of(organisation);
}
fs::path peer_dir(const std::string& dir, int organisation) {
  return organisation_dir(dir, organisation) / "peers" / ("peer0." + domain_of(organisation));
}
fs::path user_dir(const std::string& dir, int organisation, const std::string& user) {
  return organisation_dir(dir, organisation) / "users" / (user + "@" + domain_of(organisation));
}
fs::path ordering_dir(const std::string& dir) {
  return fs::path(dir) / "crypto" / "ordererOrganizations" / "ledgerline";
}
fs::path orderer_dir(const std::string& dir, int number) {
  return ordering_dir(dir) / "orderers" / orderer_name(number);
}

Status make(const std::string& dir, int orderers, const Hosts& hosts) {
  const fs::path crypto = fs::path(dir) / "crypto", unfinished = fs::path(dir) / "crypto.unfinished";
  std::error_code error;
  if (fs::exists(crypto, error)) return done;
  fs::remove_all(unfinished, error);
  if (error) return Error{"removing " + unfinished.string() + ": " + error.message()};
  if (Status s = make_all(unfinished, orderers, hosts); !s) return s;
  fs::rename(unfinished, crypto, error);
  if (error) return Error{"renaming " + unfinished.string() + ": " + error.message()};
  return sync_file_system(dir);
}

}  // namespace ledgerline::identities
