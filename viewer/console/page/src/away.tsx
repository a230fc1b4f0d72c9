// What a console without the campaign's files cannot show, and where it is.
import type { JSX } from "preact";
import type { Away } from "./data";
import { Command, Figure } from "./parts";

/** Says it of a case or of a campaign: `what` is missing here. */
export function AwayFiles({ away, what }: { away: Away; what: string }): JSX.Element {
  return (
    <Figure title="Files that are not here">
      <p>
        {what} stand in files that this console cannot reach: what it shows came from the conductor and from the simulators.
      </p>
      {away.command !== null ? (
        <>
          <p>
            They lie in <code>{away.folder}</code>, as the conductor sees it. On its machine, or on one that shares the folder, this shows them:
          </p>
          <Command text={away.command} label="Command that shows the files" />
        </>
      ) : (
        <p>They lie where the conductor runs; start the console there.</p>
      )}
    </Figure>
  );
}
