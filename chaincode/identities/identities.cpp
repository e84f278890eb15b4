#include "chaincode/identities/identities.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

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

/// Writes one organisation's files; the first failure stops it.
class Organisation {
 public:
  Organisation(const fs::path& crypto, int number, const Issued& issued)
      : domain_(domain_of(number)),
        root_(crypto / (number == 0 ? "ordererOrganizations" : "peerOrganizations") / domain_),
        issued_(issued) {}

  Status write(const std::vector<Wanted>& wanted) {
    for (const auto& [name, authority] : {std::pair{"ca", &issued_.ca}, std::pair{"tlsca", &issued_.tls_ca}}) {
      const fs::path file = root_ / name / (std::string(name) + "." + domain_ + "-cert.pem");
      if (Status s = write_public(file, authority->certificate_pem); !s) return s;
      if (authority->key_pem.empty()) continue;
      if (Status s = write_secret(root_ / name / "priv_sk", authority->key_pem); !s) return s;
    }
    if (Status s = write_msp(root_ / "msp"); !s) return s;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const auto& one = wanted[i];
      if (Status s = one.request.tls ? write_tls(one, issued_.members[i]) : write_member(one, issued_.members[i]); !s) {
        return s;
      }
    }
    return done;
  }

 private:
  Status write_member(const Wanted& wanted, const crypto::KeyAndCertificate& identity) {
    const fs::path msp = root_ / wanted.folder / "msp";
    if (Status s = write_msp(msp); !s) return s;
    const std::string file = wanted.request.common_name + "-cert.pem";
    if (Status s = write_public(msp / "signcerts" / file, identity.certificate_pem); !s) return s;
    return write_secret(msp / "keystore" / "priv_sk", identity.key_pem);
  }

  Status write_tls(const Wanted& wanted, const crypto::KeyAndCertificate& tls) {
    const fs::path folder = root_ / wanted.folder / "tls";
    if (Status s = write_public(folder / "ca.crt", issued_.tls_ca.certificate_pem); !s) return s;
    if (Status s = write_public(folder / (wanted.tls_name + ".crt"), tls.certificate_pem); !s) return s;
    return write_secret(folder / (wanted.tls_name + ".key"), tls.key_pem);
  }

  Status write_msp(const fs::path& msp) const {
    const std::string ca_file = "ca." + domain_ + "-cert.pem";
    if (Status s = write_public(msp / "cacerts" / ca_file, issued_.ca.certificate_pem); !s) return s;
    const std::string tls_file = "tlsca." + domain_ + "-cert.pem";
    if (Status s = write_public(msp / "tlscacerts" / tls_file, issued_.tls_ca.certificate_pem); !s) return s;
    std::string config = "NodeOUs:\n  Enable: true\n";
    for (const char* unit : {"Client", "Peer", "Admin", "Orderer"}) {
      std::string lower = unit;
      lower[0] = static_cast<char>(lower[0] - 'A' + 'a');
      config += "  " + std::string(unit) + "OUIdentifier:\n    Certificate: cacerts/" + ca_file +
                "\n    OrganizationalUnitIdentifier: " + lower + "\n";
    }
    return write_public(msp / "config.yaml", config);
  }

  const std::string domain_;
  const fs::path root_;
  const Issued& issued_;
};

std::vector<std::string> names_of_server(const std::string& name, const std::vector<std::string>& hosts, int number) {
  std::vector<std::string> names{name, "localhost", "127.0.0.1"};
  const auto index = static_cast<std::size_t>(number - 1);
  if (index < hosts.size() && hosts[index] != names.back()) names.push_back(hosts[index]);
  return names;
}

Status make_all(const fs::path& crypto, int orderers, const Hosts& hosts, const Issue& issue) {
  std::vector<std::vector<Wanted>> wanted;
  for (int number = 0; number <= organisations; ++number) wanted.push_back(wanted_of(number, orderers, hosts));
  const auto issued = issue(wanted);
  if (!issued) return issued.error();
  for (int number = 0; number <= organisations; ++number) {
    Organisation organisation(crypto, number, issued->at(number));
    if (Status s = organisation.write(wanted[number]); !s) return s;
  }
  return done;
}

Result<Issued> issue_of(int organisation, const std::vector<Wanted>& wanted) {
  const std::string domain = domain_of(organisation);
  Issued issued;
  for (const auto& [name, authority] : {std::pair{"ca.", &issued.ca}, std::pair{"tlsca.", &issued.tls_ca}}) {
    auto made = crypto::make_ca(name + domain, domain);
    if (!made) return made.error();
    *authority = std::move(*made);
  }
  for (const Wanted& one : wanted) {
    auto made = crypto::issue(one.request.tls ? issued.tls_ca : issued.ca, one.request);
    if (!made) return made.error();
    issued.members.push_back(std::move(*made));
  }
  return issued;
}

}  // namespace

std::string domain_of(int organisation) {
  return organisation == 0 ? "ledgerline" : "org" + std::to_string(organisation) + ".ledgerline";
}
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

std::vector<Wanted> wanted_of(int organisation, int orderers, const Hosts& hosts) {
  const std::string domain = domain_of(organisation);
  std::vector<Wanted> all;
  const auto add = [&](const fs::path& folder, const std::string& name, const std::string& unit,
                       const std::vector<std::string>& sans) {
    crypto::CertificateRequest request;
    request.common_name = name;
    request.organization = domain;
    request.unit = unit;
    if (!unit.empty()) all.push_back({folder, "", request});
    request.unit.reset();
    request.tls = true;
    request.sans = sans;
    all.push_back({folder, sans.empty() ? "client" : "server", request});
  };
  const auto add_user = [&](const std::string& user, const char* unit) {
    const std::string name = user + "@" + domain;
    add(fs::path("users") / name, name, unit, {});
  };
  add_user("Admin", "admin");
  if (organisation == 0) {
    for (int number = 1; number <= orderers; ++number) {
      const std::string name = orderer_name(number);
      add(fs::path("orderers") / name, name, "orderer", names_of_server(name, hosts.orderers, number));
    }
    return all;
  }
  const std::string chaincode = "chaincode." + domain;
  for (const std::string& peer : {"peer0." + domain, "endorser0." + domain})
    add(fs::path("peers") / peer, peer, "peer", names_of_server(peer, hosts.organisations, organisation));
  // A server that signs nothing.
  add("chaincode", chaincode, "", names_of_server(chaincode, hosts.organisations, organisation));
  for (const char* user : {"User1", "User2"}) add_user(user, "client");
  return all;
}

Result<std::vector<Issued>> issue_here(const std::vector<std::vector<Wanted>>& wanted) {
  std::vector<Issued> all;
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    auto issued = issue_of(static_cast<int>(k), wanted[k]);
    if (!issued) return issued.error();
    all.push_back(std::move(*issued));
  }
  return all;
}

Status make(const std::string& dir, int orderers, const Hosts& hosts, const Issue& issue) {
  const fs::path crypto = fs::path(dir) / "crypto", unfinished = fs::path(dir) / "crypto.unfinished";
  std::error_code error;
  if (fs::exists(crypto, error)) return done;
  fs::remove_all(unfinished, error);
  if (error) return Error{"removing " + unfinished.string() + ": " + error.message()};
  if (Status s = make_all(unfinished, orderers, hosts, issue); !s) return s;
  fs::rename(unfinished, crypto, error);
  if (error) return Error{"renaming " + unfinished.string() + ": " + error.message()};
  return sync_file_system(dir);
}

}  // namespace ledgerline::identities

namespace ledgerline {

namespace {

constexpr int first_drones = 16;

template <typename Message>
void add_drones(Message& call) {
  for (int number = 1; number <= first_drones; ++number) call.add_drones("tello" + std::to_string(number));
}

EnrollCall enrolment(const crypto::IdentityName& user) {
  EnrollCall call;
  call.mutable_identity()->set_msp_id(user.msp_id);
  call.mutable_identity()->set_subject(user.subject);
  return call;
}

GrantCall grant_to_operators() {
  GrantCall call;
  add_drones(call);
  Grant& grant = *call.mutable_grant();
  grant.mutable_to()->set_msp_id("Org2MSP");
  grant.set_fly(true);
  grant.set_stop(true);
  grant.set_cut(true);
  grant.set_max_priority(contract::max_priority);
  return call;
}

}  // namespace

std::vector<FirstCall> first_calls(int organisation, const crypto::IdentityName& user) {
  EnrollCall enroll = enrolment(user);
  if (organisation == 1) {
    add_drones(enroll);
    return {{contract::enroll, enroll.SerializeAsString()},
            {contract::grant, grant_to_operators().SerializeAsString()}};
  }
  if (organisation != 2) return {};
  enroll.set_role(OPERATOR);
  return {{contract::enroll, enroll.SerializeAsString()}};
}

}  // namespace ledgerline
