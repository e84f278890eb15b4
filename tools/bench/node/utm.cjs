// Registers a job's operational intents by Fabric's official client, through the gateway.
// Started by ledgerline-bench: node utm.cjs JOB (a file) LEDGER (JSON).
'use strict';
const crypto = require('node:crypto');
const fs = require('node:fs');
const path = require('node:path');
const grpc = require('@grpc/grpc-js');
const { CommitError, connect, signers } = require('@hyperledger/fabric-gateway');

const [jobFile, ledgerText] = process.argv.slice(2);
const job = JSON.parse(fs.readFileSync(jobFile));
const ledger = JSON.parse(ledgerText);
const mvccConflict = 11;
const taken = 'has anchored this digest already';

const say = (line) => process.stdout.write(`${JSON.stringify(line)}\n`);
const elapsedMs = (start) => Number(process.hrtime.bigint() - start) / 1e6;
// A GatewayError lists what peers said; gRPC's own errors have a text.
const textOf = (error) => (Array.isArray(error.details)
  ? `${error.message} ${error.details.map((detail) => detail.message)}` : error.message);
const only = (dir) => fs.readFileSync(path.join(ledger.mspDir, dir, fs.readdirSync(path.join(ledger.mspDir, dir))[0]));
const rpc = new grpc.Client(ledger.endpoint, grpc.credentials.createSsl(fs.readFileSync(ledger.tlsCa)));
const client = connect({
  client: rpc, identity: { mspId: ledger.mspId, credentials: only('signcerts') },
  signer: signers.newPrivateKeySigner(crypto.createPrivateKey(only('keystore'))),
  evaluateOptions: () => ({ deadline: Date.now() + 60_000 }),
  endorseOptions: () => ({ deadline: Date.now() + 60_000 }),
  submitOptions: () => ({ deadline: Date.now() + 60_000 }),
  commitStatusOptions: () => ({ deadline: Date.now() + 60_000 }),
});
const contract = client.getNetwork('teleop').getContract('ledgerline');

let start = 0n;
let ended = 0;
let why = '';
const lines = [];
const open = job.intents.map(() => ({ attempts: 0, conflicts: 0, ended: false }));

function close(i, end) {
  if (open[i].ended) return;
  open[i].ended = true;
  ended += 1;
  if (!job.intents[i].measured) return;
  lines.push([end, Math.max(1, open[i].attempts), open[i].conflicts, job.intents[i].at_ns / 1e6, elapsedMs(start)]);
}

// As RetryPolicy in workload.hpp.
const pauseMs = (attempt) => Math.min(job.max_ms, job.first_ms * 2 ** (attempt - 1)) * (0.5 + 0.5 * Math.random());

async function register(i) {
  const { airspace, what } = job.intents[i];
  const call = JSON.stringify({ digest: crypto.createHash('sha256').update(airspace).digest('base64'), what });
  while (!open[i].ended) {
    open[i].attempts += 1;
    try {
      await contract.submitTransaction('anchor', call);
      close(i, 'registered');
    } catch (error) {
      const text = textOf(error);
      if (text.includes(taken)) {
        close(i, 'refused');
        return;
      }
      why = text;
      const conflict = error instanceof CommitError && error.code === mvccConflict;
      if (conflict) open[i].conflicts += 1;
      if (!conflict || open[i].attempts >= job.attempts) {
        close(i, 'lost');
        return;
      }
      await new Promise((resolve) => setTimeout(resolve, pauseMs(open[i].attempts)));
    }
  }
}

function end() {
  job.intents.forEach((_, i) => close(i, 'lost'));
  for (let i = 0; i < lines.length; i += 500) say({ ended: lines.slice(i, i + 500) });
  process.stdout.write(`${JSON.stringify({ result: { why } })}\n`, () => process.exit(0));
}

function registerAll() {
  start = process.hrtime.bigint();
  const lastMs = job.intents.length === 0 ? 0 : job.intents[job.intents.length - 1].at_ns / 1e6;
  let next = 0;
  const turn = () => {
    const ms = elapsedMs(start);
    if (ended === job.intents.length || ms >= lastMs + 1000 * job.drain_s) {
      end();
      return;
    }
    for (; next < job.intents.length && job.intents[next].at_ns / 1e6 <= ms; next += 1) register(next);
    const due = next < job.intents.length ? job.intents[next].at_ns / 1e6 - elapsedMs(start) : 20;
    setTimeout(turn, Math.min(due, 100));
  };
  turn();
}

process.on('SIGTERM', end);
rpc.waitForReady(Date.now() + 20_000, (error) => {
  if (error) {
    process.stderr.write(`${error.stack}\n`);
    process.exit(1);
  }
  say({ ready: true, pid: process.pid });
  registerAll();
});
