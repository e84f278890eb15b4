#include "chaincode/network/files/authority.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "chaincode/network/processes/processes.hpp"
#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::network {
namespace {

namespace fs = std::filesystem;
using identities::domain_of;

constexpr std::size_t secret_bytes = 16;
constexpr const char* registrar = "registrar";

fs::path home_of(const std::string& dir, int organisation) { return fs::path(dir) / "ca" / domain_of(organisation); }
fs::path certificate_of(const std::string& dir, int organisation) { return home_of(dir, organisation) / "ca-cert.pem"; }

/// Roles of members are the types of NodeOUs. The registrar has one that no MSP knows, so its certificate registers and
/// revokes and is no member of the channel.
std::string server_config(const Authorities& authorities, int organisation, const std::string& secret) {
  const std::string domain = domain_of(organisation);
  const ListenAddress& address = authorities.addresses[organisation];
  // Certificates and lists hold for ten years, as those of chaincode/identities do.
  return fmt::format(R"yaml(address: {host}
port: {port}
tls: {{enabled: true}}
ca: {{name: ca.{domain}}}
crl: {{expiry: 87600h}}
registry:
  maxenrollments: -1
  identities:
    - name: {registrar}
      pass: {secret}
      type: {registrar}
      attrs: {{hf.Registrar.Roles: "*", hf.Revoker: true, hf.GenCRL: true}}
db: {{type: sqlite3, datasource: fabric-ca-server.db}}
signing:
  default: {{usage: [digital signature], expiry: 87600h}}
  profiles:
    tls: {{usage: [signing, key encipherment, server auth, client auth], expiry: 87600h}}
csr:
  cn: ca.{domain}
  keyrequest: {{algo: ecdsa, size: 256}}
  names: [{{O: {domain}}}]
  hosts: [localhost, {host}]
  ca: {{expiry: 131400h, pathlength: 0}}
bccsp: {{default: SW, sw: {{hash: SHA2, security: 256, filekeystore: {{keystore: msp/keystore}}}}}}
cfg: {{identities: {{passwordattempts: 10}}}}
operations: {{listenAddress: "127.0.0.1:0"}}
metrics: {{provider: disabled}}
)yaml",
                     fmt::arg("host", address.host), fmt::arg("port", address.port), fmt::arg("domain", domain),
                     fmt::arg("registrar", registrar), fmt::arg("secret", secret));
}

/// fabric-ca-client as somebody whose key is in `home`; with a secret: to enrol as `name`.
Command client_command(const Authorities& authorities, int organisation, const std::string& what, const fs::path& home,
                       std::vector<std::string> words, const std::string& name = {}, const std::string& secret = {}) {
  words.insert(words.begin(), authorities.tools + "/fabric-ca-client");
  const std::string who = name.empty() ? "" : name + ":" + secret + "@";
  return {what,
          std::move(words),
          {"FABRIC_CA_CLIENT_HOME=" + home.string(),
           "FABRIC_CA_CLIENT_URL=https://" + who + authorities.addresses[organisation].text(),
           "FABRIC_CA_CLIENT_TLS_CERTFILES=" + certificate_of(authorities.dir, organisation).string()}};
}

/// Who is registered. TLS has a name of its own, whose type is none of NodeOUs: though one CA signs both, no MSP takes
/// a certificate for TLS, whose key lies in more places, for a member's.
std::string name_at_authority(const std::string& member, bool tls) { return (tls ? "tls." : "") + member; }

/// Where a member's certificate comes to first; removed when it is in the layout.
fs::path issuing_dir(const Authorities& authorities, int organisation) {
  return home_of(authorities.dir, organisation) / "issuing";
}

/// Registers and enrols all of an organisation.
std::vector<Command> issuing_commands(const Authorities& authorities, int organisation,
                                      const std::vector<identities::CertificateSpec>& wanted,
                                      const std::string& secret) {
  const fs::path own = home_of(authorities.dir, organisation) / registrar;
  std::vector<Command> commands{client_command(authorities, organisation,
                                               fmt::format("enrolling the registrar of {}", domain_of(organisation)),
                                               own, {"enroll"}, registrar, secret)};
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const auto& request = wanted[i].request;
    const std::string name = name_at_authority(request.common_name, request.tls);
    const std::string its_secret = crypto::hex(crypto::random_bytes(secret_bytes));
    Command registering = client_command(
        authorities, organisation, "registering " + name, own,
        {"register", "--id.name", name, "--id.type", request.unit.value_or("tls"), "--id.maxenrollments", "1"});
    registering.environment.push_back("FABRIC_CA_CLIENT_ID_SECRET=" + its_secret);
    commands.push_back(std::move(registering));
    std::string hosts = request.sans.empty() ? request.common_name : "";  // none: it would take this machine's name
    for (const std::string& san : request.sans) hosts += (hosts.empty() ? "" : ",") + san;
    std::vector<std::string> words{"enroll", "--csr.names", "O=" + request.organization, "--csr.hosts", hosts};
    if (request.tls) words.insert(words.end(), {"--enrollment.profile", "tls"});
    commands.push_back(client_command(authorities, organisation, "enrolling " + name,
                                      issuing_dir(authorities, organisation) / std::to_string(i), std::move(words),
                                      name, its_secret));
  }
  return commands;
}

/// A call of fabric-ca-client.
struct Revoking {
  std::string what;
  std::vector<std::string> words;
};

Result<Revoking> revoking_user(int organisation, const std::string& user) {
  // As chaincode/identities names them: a peer has a host's name.
  const std::string name = user + (user == "endorser0" ? "." : "@") + domain_of(organisation);
  return Revoking{"revoking " + name, {"revoke", "--revoke.name", name}};
}

Result<Revoking> revoking_certificate(const std::string& pem) {
  const auto number = crypto::certificate_number(pem);
  if (!number) return number.error();
  return Revoking{"revoking certificate " + number->serial,
                  {"revoke", "--revoke.serial", number->serial, "--revoke.aki", number->authority_key}};
}

Result<crypto::KeyAndCertificate> read_enrolled(const fs::path& home) {
  std::error_code error;
  fs::path key;
  for (const auto& entry : fs::directory_iterator(home / "msp" / "keystore", error)) {
    if (entry.path().filename().string().ends_with("_sk")) key = entry.path();
  }
  if (key.empty()) return Error{(home / "msp" / "keystore").string() + " has no key"};
  const auto certificate = read_file(home / "msp" / "signcerts" / "cert.pem"), secret = crypto::read_key_file(key);
  if (!certificate) return certificate.error();
  if (!secret) return secret.error();
  return crypto::KeyAndCertificate{*secret, *certificate};
}

}  // namespace

Authorities authorities(const Options& options, const ListenAddresses& addresses) {
  return {options.dir, options.tools, addresses.authorities};
}

bool has_authorities(const std::string& dir) { return fs::exists(fs::path(dir) / "ca"); }
std::string authority_name(int organisation) { return fmt::format("ca{}", organisation); }

Status prepare_authorities(const Authorities& authorities) {
  for (const char* program : {"fabric-ca-server", "fabric-ca-client"}) {
    if (fs::exists(authorities.tools + "/" + program)) continue;
    return Error{fmt::format("{}/{} is missing: scripts/fabric-tools --ca builds it (with Go 1.24 or newer)",
                             authorities.tools, program)};
  }
  std::error_code error;
  const fs::path all = fs::path(authorities.dir) / "ca";
  if (!fs::exists(fs::path(authorities.dir) / "crypto")) fs::remove_all(all, error);
  if (error) return Error{"removing " + all.string() + ": " + error.message()};
  for (int k = 0; k <= identities::organisations; ++k) {
    const fs::path home = home_of(authorities.dir, k);
    fs::create_directories(home, error);
    if (error) return Error{"making " + home.string() + ": " + error.message()};
    if (::chmod(all.c_str(), 0700) != 0) return Error{"chmod " + all.string() + ": " + std::strerror(errno)};
    if (!fs::exists(home / "registrar.secret")) {
      Status written = write_file(home / "registrar.secret", crypto::hex(crypto::random_bytes(secret_bytes)), 0600);
      if (!written) return written;
    }
    const auto secret = read_file(home / "registrar.secret");
    if (!secret) return secret.error();
    if (Status s = write_file(home / "fabric-ca-server-config.yaml", server_config(authorities, k, *secret), 0600); !s)
      return s;
  }
  return done;
}

std::vector<std::string> authority_command(const Authorities& authorities) {
  return {authorities.tools + "/fabric-ca-server", "start"};
}
std::vector<std::string> authority_environment(const Authorities& authorities, int organisation) {
  return {"FABRIC_CA_SERVER_HOME=" + home_of(authorities.dir, organisation).string()};
}

bool authority_listens(const Authorities& authorities, int organisation) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = authorities.addresses[organisation].address();
  const bool listens = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::close(fd);
  return listens;
}

Result<std::vector<identities::IssuedCertificates>> issue_by_authorities(
    const Authorities& authorities, const std::vector<std::vector<identities::CertificateSpec>>& wanted) {
  std::vector<std::vector<Command>> lanes;
  for (int k = 0; k < static_cast<int>(wanted.size()); ++k) {
    const auto secret = read_file(home_of(authorities.dir, k) / "registrar.secret");
    if (!secret) return secret.error();
    lanes.push_back(issuing_commands(authorities, k, wanted[k], *secret));
  }
  if (const auto ran = run_lanes(lanes, authorities.dir + "/logs/enrolment"); !ran) return ran.error();
  std::vector<identities::IssuedCertificates> all(wanted.size());
  for (int k = 0; k < static_cast<int>(wanted.size()); ++k) {
    const auto ca = read_file(certificate_of(authorities.dir, k));
    if (!ca) return ca.error();
    all[k].ca.certificate_pem = all[k].tls_ca.certificate_pem = *ca;
    for (std::size_t i = 0; i < wanted[k].size(); ++i) {
      auto taken = read_enrolled(issuing_dir(authorities, k) / std::to_string(i));
      if (!taken) return taken.error();
      all[k].members.push_back(std::move(*taken));
    }
    std::error_code error;
    fs::remove_all(issuing_dir(authorities, k), error);
    if (error) return Error{"removing " + issuing_dir(authorities, k).string() + ": " + error.message()};
  }
  return all;
}

Result<std::string> revoke_at_authority(const Authorities& authorities, int organisation, const Revoked& revoked) {
  const fs::path own = home_of(authorities.dir, organisation) / registrar;
  const std::string log = authorities.dir + "/logs/revocation-at-authority.log";
  const bool one = !revoked.certificate_pem.empty();
  const auto revoking = one ? revoking_certificate(revoked.certificate_pem) : revoking_user(organisation, revoked.user);
  if (!revoking) return revoking.error();
  const auto ran = run_command(client_command(authorities, organisation, revoking->what, own, revoking->words), log);
  // Of a certificate that is revoked already the server says so by an error: the list shows it.
  if (!ran && !one) return ran.error();
  const auto made =
      run_command(client_command(authorities, organisation, "listing what is revoked", own, {"gencrl"}), log);
  if (!made) return made.error();
  auto list = read_file(own / "msp" / "crls" / "crl.pem");
  if (!list || !one) return list;
  const auto listed = crypto::is_listed(*list, revoked.certificate_pem);
  if (!listed) return listed.error();
  if (*listed) return list;
  return ran ? Error{"the authority lists no certificate that has ended, and peers refuse those as they are"}
             : ran.error();
}

}  // namespace ledgerline::network
