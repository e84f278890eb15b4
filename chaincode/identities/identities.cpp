#include "chaincode/identities/identities.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::identities {

namespace {

namespace fs = std::filesystem;

// All files under `dir`, and its own names, survive a loss of power from here on; done at the first start alone.
Status sync_file_system(const std::string& dir) {
  const int fd = ::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = fd >= 0 && ::syncfs(fd) == 0;
  const std::string why = synced ? "" : std::strerror(errno);
  if (fd >= 0) ::close(fd);
  if (!synced) return Error{"syncing " + dir + ": " + why};
  return done;
}

/// A file of an organisation's, below its folder.
struct MspFile {
  fs::path path;
  std::string content;
  int mode = 0644;  ///< 0600: a key
};

void add_msp(std::vector<MspFile>& files, const fs::path& msp, const std::string& domain,
             const IssuedCertificates& issued) {
  const std::string ca_file = "ca." + domain + "-cert.pem";
  files.push_back({msp / "cacerts" / ca_file, issued.ca.certificate_pem});
  files.push_back({msp / "tlscacerts" / ("tlsca." + domain + "-cert.pem"), issued.tls_ca.certificate_pem});
  std::string config = "NodeOUs:\n  Enable: true\n";
  for (const auto& [unit, name] :
       {std::pair{"Client", "client"}, {"Peer", "peer"}, {"Admin", "admin"}, {"Orderer", "orderer"}})
    config += std::string("  ") + unit + "OUIdentifier:\n    Certificate: cacerts/" + ca_file +
              "\n    OrganizationalUnitIdentifier: " + name + "\n";
  files.push_back({msp / "config.yaml", config});
}

/// All files of an organisation; `specs` and the members of `issued` are in the same order.
std::vector<MspFile> files_of(const std::string& domain, const std::vector<CertificateSpec>& specs,
                              const IssuedCertificates& issued) {
  std::vector<MspFile> files;
  for (const auto& [name, authority] : {std::pair{"ca", &issued.ca}, std::pair{"tlsca", &issued.tls_ca}}) {
    files.push_back({fs::path(name) / (std::string(name) + "." + domain + "-cert.pem"), authority->certificate_pem});
    if (!authority->key_pem.empty()) files.push_back({fs::path(name) / "priv_sk", authority->key_pem, 0600});
  }
  add_msp(files, "msp", domain, issued);
  for (std::size_t i = 0; i < specs.size(); ++i) {
    const CertificateSpec& spec = specs[i];
    const crypto::KeyAndCertificate& own = issued.members[i];
    if (spec.request.tls) {
      const fs::path folder = spec.folder / "tls";
      files.push_back({folder / "ca.crt", issued.tls_ca.certificate_pem});
      files.push_back({folder / (spec.tls_name + ".crt"), own.certificate_pem});
      files.push_back({folder / (spec.tls_name + ".key"), own.key_pem, 0600});
      continue;
    }
    const fs::path msp = spec.folder / "msp";
    add_msp(files, msp, domain, issued);
    files.push_back({msp / "signcerts" / (spec.request.common_name + "-cert.pem"), own.certificate_pem});
    files.push_back({msp / "keystore" / "priv_sk", own.key_pem, 0600});
  }
  return files;
}

std::vector<std::string> names_of_server(const std::string& name, const std::vector<std::string>& hosts, int number) {
  std::vector<std::string> names{name, "localhost", "127.0.0.1"};
  const auto index = static_cast<std::size_t>(number - 1);
  if (index < hosts.size() && hosts[index] != names.back()) names.push_back(hosts[index]);
  return names;
}

Status make_all(const fs::path& crypto, int orderers, const Hosts& hosts, const Issue& issue) {
  std::vector<std::vector<CertificateSpec>> wanted;
  for (int number = 0; number <= organisations; ++number) wanted.push_back(certificate_specs(number, orderers, hosts));
  const auto issued = issue(wanted);
  if (!issued) return issued.error();
  for (int number = 0; number <= organisations; ++number) {
    const std::string domain = domain_of(number);
    const fs::path folder = crypto / (number == 0 ? "ordererOrganizations" : "peerOrganizations") / domain;
    for (const MspFile& file : files_of(domain, wanted[number], issued->at(number)))
      if (Status s = write_file(folder / file.path, file.content, file.mode); !s) return s;
  }
  return done;
}

Result<IssuedCertificates> issue_of(int organisation, const std::vector<CertificateSpec>& wanted) {
  const std::string domain = domain_of(organisation);
  IssuedCertificates issued;
  for (const auto& [name, authority] : {std::pair{"ca.", &issued.ca}, std::pair{"tlsca.", &issued.tls_ca}}) {
    auto made = crypto::make_ca(name + domain, domain);
    if (!made) return made.error();
    *authority = std::move(*made);
  }
  for (const CertificateSpec& one : wanted) {
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

std::vector<CertificateSpec> certificate_specs(int organisation, int orderers, const Hosts& hosts) {
  const std::string domain = domain_of(organisation);
  std::vector<CertificateSpec> all;
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

Result<std::vector<IssuedCertificates>> issue_here(const std::vector<std::vector<CertificateSpec>>& wanted) {
  std::vector<IssuedCertificates> all;
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
  if (Status s = sync_file_system(dir); !s) return s;
  fs::rename(unfinished, crypto, error);
  if (error) return Error{"renaming " + unfinished.string() + ": " + error.message()};
  return sync_file_system(dir);
}

}  // namespace ledgerline::identities

namespace ledgerline {

namespace {

constexpr int first_drones = 16;

template <typename Message>
void add_drones(Message& call, const std::vector<std::string>& drones) {
  for (const std::string& name : drones) call.add_drones(name);
  for (int number = 1; drones.empty() && number <= first_drones; ++number)
    call.add_drones("tello" + std::to_string(number));
}

EnrollCall enrolment(const crypto::IdentityName& user) {
  EnrollCall call;
  call.mutable_identity()->set_msp_id(user.msp_id);
  call.mutable_identity()->set_subject(user.subject);
  return call;
}

GrantCall grant_to_operators(const std::vector<std::string>& drones) {
  GrantCall call;
  add_drones(call, drones);
  Grant& grant = *call.mutable_grant();
  grant.mutable_to()->set_msp_id("Org2MSP");
  grant.set_fly(true);
  grant.set_stop(true);
  grant.set_cut(true);
  grant.set_max_priority(contract::max_priority);
  return call;
}

}  // namespace

std::vector<FirstCall> first_calls(int organisation, const crypto::IdentityName& user,
                                   const std::vector<std::string>& drones) {
  EnrollCall enroll = enrolment(user);
  if (organisation == 1) {
    add_drones(enroll, drones);
    return {{contract::enroll, enroll.SerializeAsString()},
            {contract::grant, grant_to_operators(drones).SerializeAsString()}};
  }
  if (organisation != 2) return {};
  enroll.set_role(OPERATOR);
  return {{contract::enroll, enroll.SerializeAsString()}};
}

}  // namespace ledgerline
