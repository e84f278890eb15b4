#include <fmt/format.h>

#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/dds/settings/security.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"

namespace {

using namespace ledgerline;

struct Wish {
  std::string ca, ca_key, out;
  std::vector<std::string> members;
};

Status make_documents(const Wish& wish) {
  auto ca = read_file(wish.ca);
  if (!ca) return ca.error();
  auto ca_key = read_file(wish.ca_key);
  if (!ca_key) return ca_key.error();
  std::vector<std::string> members;
  for (const std::string& file : wish.members) {
    auto member = read_file(file);
    if (!member) return member.error();
    members.push_back(std::move(member).value());
  }
  const auto made = dds::make_security_documents({std::move(ca_key).value(), std::move(ca).value()}, members);
  if (!made) return made.error();
  for (const auto& [name, text] :
       {std::pair("identity_ca.pem", &made->identity_ca), std::pair("governance.p7s", &made->governance),
        std::pair("permissions.p7s", &made->permissions)}) {
    const std::string file = wish.out + "/" + name;
    if (auto status = write_file(file, *text); !status) return status;
    fmt::print("{}\n", file);
  }
  return done;
}

constexpr const char* about =
    "Makes what DDS Security needs from an organisation's authority: identity_ca.pem, governance.p7s and\n"
    "permissions.p7s, the same for all members. [dds] of a program's config names them, and its own certificate and\n"
    "key. A new member needs new permissions; the others keep theirs. Prints the files that it wrote.";
constexpr const char* notes = R"(Example:
  ledgerline dds-security --ca ca.pem --ca-key ca.key --out dds drone-host.pem ground-host.pem

Exit codes: 0 done, 1 not so, 2 bad usage.)";

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("dds-security", about, notes);
  Wish wish;
  line.option("--ca", wish.ca, "the authority's certificate, PEM").required();
  line.option("--ca-key", wish.ca_key, "its private key, PEM").required();
  line.option("--out", wish.out, "folder").required();
  line.option("MEMBER", wish.members, "certificates that it has issued (P-256), PEM").required();
  if (const auto end = line.parse(argc, argv)) return *end;
  return exit_code(make_documents(wish));
}
